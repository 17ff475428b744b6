"""What kinematics needs of a URDF or xacro file, and nothing else of it.

`urdf_parser_py` fills gaps silently and complains on stderr about every tag it does not know. So the file is
reduced and checked here first; what is left can neither be misread nor name a mesh.
"""

from __future__ import annotations

import contextlib
import io
import math
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot, suggest

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")

_XACRO = "http://www.ros.org/wiki/xacro"

_KEPT = ("origin", "parent", "child", "axis", "limit", "mimic")
"""Elements of a joint that say where it is and how it moves."""

_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""How many values each attribute holds."""

_REQUIRED = {"parent": "link", "child": "link", "axis": "xyz", "mimic": "joint"}


def file_bytes(path: Path) -> bytes:
    """Read a whole file.

    Raises:
        InvalidRobot: There is no such file, or it cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        nearby = [p.name for p in path.parent.glob("*") if p.suffix in {".urdf", ".xacro", ".xml"}]
        hint = f" ({suggest(path.name, nearby, 'file')})" if nearby else ""
        raise InvalidRobot(f"no file {str(path)!r}{hint}") from None
    except OSError as error:
        raise InvalidRobot(f"cannot read {str(path)!r}: {error.strerror}") from error


def root_element(text: bytes, where: str) -> Any:
    """Parse XML, comments and processing instructions left out.

    Raises:
        InvalidRobot: Broken XML; the message holds the parser's own, with the line.
    """
    from lxml import etree

    parser = etree.XMLParser(
        remove_comments=True, remove_pis=True, resolve_entities=False, no_network=True, huge_tree=True
    )
    try:
        return etree.fromstring(text, parser)
    except etree.XMLSyntaxError as error:
        raise InvalidRobot(f"{where}: broken XML: {error.msg}") from error


def expand_xacro(path: Path) -> bytes:
    """Turn a xacro file into URDF text.

    Raises:
        InvalidRobot: The file is missing, or xacro cannot process it; the message is xacro's own.
    """
    file_bytes(path)
    from xacrodoc import XacroDoc, packages
    from xacrodoc.xacrodoc import xacro

    said = io.StringIO()
    before = packages._finder
    try:
        # Packages found on the way up from one file must not answer for the next file: use a copy.
        packages._finder = packages.PackageFinder()
        packages._finder.finder_funcs[:] = before.finder_funcs
        packages._finder.package_cache.update(before.package_cache)
        xacro.init_stacks(str(path))  # Or relative includes would be looked for in the working directory.
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
            return bytes(XacroDoc.from_file(str(path), resolve_packages=False).dom.toxml(encoding="utf-8"))
    except Exception as error:  # xacro evaluates expressions of the file: anything may come out of it.
        raise InvalidRobot(f"{path}: xacro failed: {error or type(error).__name__}") from error
    finally:
        packages._finder = before


def kinematic_part(root: Any, name: str, where: str) -> Any:
    """Copy the links and joints of a robot, checked, in the form `urdf_parser_py` reads without a word.

    Args:
        root: The root element of the file.
        name: Name of the robot where the file gives none.
        where: The file, for messages.

    Raises:
        InvalidRobot: Not a robot, or a joint that cannot be read.
    """
    from lxml import etree

    tag = etree.QName(root).localname
    if tag != "robot":
        raise InvalidRobot(f"{where}: not a robot: the root tag is <{tag}>, expected <robot>")
    if next(root.iter(f"{{{_XACRO}}}*"), None) is not None:
        raise InvalidRobot(f"{where}: the file holds xacro commands; name it .xacro to have them expanded")
    space = root.tag.removesuffix("robot")

    robot = etree.Element("robot", name=root.get("name") or name)
    for link in root.iterchildren(f"{space}link"):
        etree.SubElement(robot, "link", name=_name(link, "link", where))
    for joint in root.iterchildren(f"{space}joint"):
        _copy_joint(joint, etree.SubElement(robot, "joint"), space, where)
    return robot


def _copy_joint(joint: Any, copy: Any, space: str, where: str) -> None:
    from lxml import etree

    name = _name(joint, "joint", where)
    here = f"{where}: joint {name!r}"
    kind = joint.get("type")
    if kind not in JOINT_TYPES:
        raise InvalidRobot(
            f"{here}: {suggest(kind, JOINT_TYPES, 'joint type')}" if kind else f"{here}: no type"
        )
    copy.set("name", name)
    copy.set("type", kind)
    for tag in _KEPT:
        found = joint.findall(space + tag)
        if len(found) > 1:
            raise InvalidRobot(f"{here}: {len(found)} <{tag}> elements, expected one")
        if not found:
            if tag in ("parent", "child"):
                raise InvalidRobot(f"{here}: no <{tag}>")
            continue
        attributes = _checked_attributes(found[0], tag, here)
        if tag == "limit":
            if not {"lower", "upper"} <= attributes.keys():
                continue  # The parser would read a missing bound as 0: no limit at all is seen later.
            attributes |= {"effort": "0", "velocity": "0"}
        etree.SubElement(copy, tag, attributes)


def _checked_attributes(element: Any, tag: str, here: str) -> dict[str, str]:
    required = _REQUIRED.get(tag)
    if required and not element.get(required):
        raise InvalidRobot(f"{here}: <{tag}> has no {required}")
    kept = {required: element.get(required)} if required else {}
    for attribute, count in _NUMBERS.get(tag, {}).items():
        text = element.get(attribute)
        if text is not None:
            _check_numbers(text, count, f"{here}: <{tag}> {attribute}={text!r}")
            kept[attribute] = text.strip()
    return kept


def _check_numbers(text: str, count: int, what: str) -> None:
    words = text.split()
    if len(words) != count:
        raise InvalidRobot(f"{what}: {len(words)} values, expected {count}")
    for word in words:
        try:
            value = float(word.replace("_", "?"))  # Python alone would take 1_000.
        except ValueError:
            raise InvalidRobot(f"{what}: {word!r} is not a number") from None
        if not math.isfinite(value):
            raise InvalidRobot(f"{what}: {word!r} is not finite")


def _name(element: Any, tag: str, where: str) -> str:
    name = element.get("name")
    if not name:
        raise InvalidRobot(f"{where}: a <{tag}> in line {element.sourceline} has no name")
    return str(name)
