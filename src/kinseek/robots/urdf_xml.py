"""What kinematics needs of a URDF or xacro file, and nothing else of it.

`urdf_parser_py` fills gaps silently and complains on stderr about every tag it does not know. So the file is
reduced and checked here first; what is left can neither be misread nor name a mesh.
"""

from __future__ import annotations

import contextlib
import math
import re
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot, suggest
from kinseek.forks import finish_first, importing
from kinseek.undisturbed import raise_of_handler

from .expressions import MOST_ENTRIES, Refused, entries, evaluate
from .files import MOST_BYTES, MOST_LINKS, file_bytes, require_few

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")

_XACRO = "http://www.ros.org/wiki/xacro"

_KEPT = ("origin", "parent", "child", "axis", "limit", "mimic")
"""Elements of a joint that say where it is and how it moves."""

_XACRO_LOCK = threading.RLock()
"""xacro keeps what it knows in its module: one file at a time."""
finish_first(_XACRO_LOCK)
_LOST_PACKAGE = re.compile(r"Package not found: (\S+)")
"""What xacrodoc says, wrapped by xacro."""
_MOST_STEPS, _MOST_LETTERS, _MOST_NESTED = 50_000, 2**20, 32
"""Elements that xacro may expand, how long a value may become, and how deep files may include each other."""
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "safety_controller": {"soft_lower_limit": 1, "soft_upper_limit": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""How many values each attribute holds."""

_REQUIRED = {"parent": "link", "child": "link", "axis": "xyz", "mimic": "joint"}


def root_element(text: bytes, where: str) -> Any:
    """Parse XML, comments and processing instructions left out.

    Raises:
        InvalidRobot: Broken XML; the message holds the parser's own, with the line.
    """
    with importing:
        from lxml import etree

    # Not huge_tree, which would lift the parser's limits on depth and on entities made of entities.
    parser = etree.XMLParser(remove_comments=True, remove_pis=True, resolve_entities=False, no_network=True)
    try:
        return etree.fromstring(text, parser)
    except (etree.XMLSyntaxError, LookupError) as error:  # An encoding that nobody knows is a LookupError.
        raise InvalidRobot(f"{where}: broken XML: {getattr(error, 'msg', None) or error}") from error


class _Arguments(dict[str, str]):
    """Arguments of a xacro file that notice which of them it asks for."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.asked: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.asked.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.asked.add(name)
        return super().__getitem__(name)


def expand_xacro(
    path: Path,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> bytes:
    """Turn a xacro file into URDF text.

    Args:
        path: The file.
        args: Values of its arguments, by name; truth values are written as xacro reads them.
        packages: Folders of ROS packages, by name. Others are looked for above the file, and where ROS has them.
        trusted: May Python evaluate its expressions? Else `expressions` does, and the environment is not read.

    Raises:
        InvalidRobot: The file is missing, an argument is none of the file's, a package is no folder, or xacro cannot process
            the file; the message is then xacro's own.
    """
    file_bytes(path)
    arguments = _Arguments({str(name): _as_xacro(value) for name, value in (args or {}).items()})
    text = _expanded(path, arguments, _folders(packages or {}), trusted)
    for name in args or {}:
        if name not in arguments.asked:
            raise InvalidRobot(f"{path}: {suggest(str(name), arguments.asked, 'argument')}")
    return text


def _as_xacro(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _folders(packages: Mapping[str, str | Path]) -> dict[str, str]:
    for name, folder in packages.items():
        if not Path(folder).expanduser().is_dir():
            raise InvalidRobot(f"package {name!r}: no folder {str(folder)!r}")
    return {name: str(Path(folder).expanduser().resolve()) for name, folder in packages.items()}


def _expanded(path: Path, arguments: _Arguments, folders: Mapping[str, str], trusted: bool) -> bytes:
    with importing:
        from xacrodoc import XacroDoc, packages

    computed = contextlib.nullcontext() if trusted else _computed_xacro(path)
    with _XACRO_LOCK, _watched_xacro(path), computed:
        before = packages._finder
        try:
            # Packages found on the way up from one file must not answer for the next file: use a copy.
            packages._finder = packages.PackageFinder()
            packages._finder.finder_funcs[:] = before.finder_funcs
            packages._finder.package_cache.update(before.package_cache | folders)
            document = XacroDoc.from_file(str(path), subargs=arguments, resolve_packages=False)
            return bytes(document.dom.toxml(encoding="utf-8"))
        except InvalidRobot:
            raise
        except Exception as error:  # xacro evaluates expressions of the file: anything may come out of it.
            raise_of_handler(getattr(error, "exc", None) or error)  # xacro's own errors wrap others.
            refused = _refusal(error)
            if refused is not None:
                raise refused from None
            why = str(error) or type(error).__name__
            if lost := _LOST_PACKAGE.search(why):
                why = f"package {lost[1]!r} is not found; say where it is with packages={{name: folder}}, in a shell "
                why += "--package NAME=FOLDER"
            raise InvalidRobot(f"{path}: xacro failed: {why}") from error
        finally:
            packages._finder = before


@contextlib.contextmanager
def _watched_xacro(path: Path) -> Iterator[None]:
    """Let xacro read regular files of a sane size alone, print nothing, and stop what grows without end.

    xacro looks these functions up in its own modules, each time that it calls them. `sys.stdout` and `sys.stderr` stay as
    they are: all threads print there.
    """
    from xacrodoc.xacrodoc import xacro

    opened, left, steps = open, MOST_BYTES, 0
    evaluate_all, evaluate_text = xacro.eval_all, xacro.eval_text

    def open_file(name: Any, *rest: Any, **options: Any) -> Any:
        nonlocal left
        require_few(
            len(xacro.filestack), "files, each included by the one before", _MOST_NESTED, f"{path}: xacro"
        )
        if Path(name).exists():  # xacro itself says best what is missing.
            left -= len(file_bytes(Path(name), left))
        return opened(name, *rest, **options)

    def eval_all(*arguments: Any) -> Any:
        nonlocal steps
        steps += 1
        require_few(steps, "elements to expand", _MOST_STEPS, f"{path}: xacro")
        return evaluate_all(*arguments)

    def eval_text(*arguments: Any) -> Any:
        value = evaluate_text(*arguments)
        if isinstance(value, str):
            require_few(len(value), "letters in one value", _MOST_LETTERS, f"{path}: xacro")
        return value

    try:
        xacro.open, xacro.eval_all, xacro.eval_text = open_file, eval_all, eval_text
        xacro.print = xacro.color.print = lambda *words, **options: None
        xacro.init_stacks(str(path))  # Or relative includes would be looked for in the working directory.
        yield
    finally:
        xacro.eval_all, xacro.eval_text = evaluate_all, evaluate_text
        for module, name in ((xacro, "open"), (xacro, "print"), (xacro.color, "print")):
            vars(module).pop(name, None)


@contextlib.contextmanager
def _computed_xacro(path: Path) -> Iterator[None]:
    """Keep xacro from Python's `eval` and from the environment: the file may be anybody's."""
    from xacro import substitution_args  # type: ignore[import-untyped]
    from xacrodoc.xacrodoc import xacro

    def load_yaml(name: str) -> Any:
        content = xacro.load_yaml(name)
        # Aliases make much of little as soon as it is written out.
        require_few(entries(content, MOST_ENTRIES), "entries of a YAML file", MOST_ENTRIES, f"{path}: {name}")
        return content

    def compute(expression: str, names: Any, functions: Mapping[str, Any]) -> Any:
        try:
            return evaluate(expression, names, functions)
        except Refused as refused:
            raise InvalidRobot(
                f"{path}: xacro: {expression.strip()[:80]!r} holds {refused}; in a file that is not trusted only plain sums "
                "are computed. If you trust it, say trusted=True"
            ) from None

    def safe_eval(expression: str, names: Any, inner: Any = None) -> Any:
        asked = xacro.substitution_args_context["arg"]
        own = {"load_yaml": load_yaml, "dotify": lambda value: value, "abs_filename": xacro.abs_filename_spec}
        own["arg"] = lambda name: asked[name]
        return compute(expression, names, own | {f"xacro.{name}": function for name, function in own.items()})

    def eval_extension(expression: str, context: Any) -> str:
        given = substitution_args._DictWrapper(context.setdefault("arg", {}), {})
        functions = {
            "arg": given.__getitem__,
            "dirname": lambda: substitution_args._eval_dirname(context["filename"]),
        }
        return str(compute(expression, given, functions))

    def unknown(name: str) -> str:
        raise InvalidRobot(
            f"{path}: xacro: $(env {name}): the environment is not read for a file that is not trusted"
        )

    kept = xacro.safe_eval
    before = {name: getattr(substitution_args, name) for name in ("_eval", "_eval_env", "_eval_optenv")}
    try:
        xacro.safe_eval = safe_eval
        substitution_args._eval, substitution_args._eval_env = eval_extension, unknown
        substitution_args._eval_optenv = lambda name, default="": default
        yield
    finally:
        xacro.safe_eval = kept
        for name, function in before.items():
            setattr(substitution_args, name, function)


def _refusal(error: BaseException) -> InvalidRobot | None:
    """Find our own refusal, which xacro may have wrapped into an error of its own."""
    inner: BaseException | None = error
    seen: set[int] = set()
    while inner is not None and id(inner) not in seen:
        if isinstance(inner, InvalidRobot):
            return inner
        seen.add(id(inner))
        inner = getattr(inner, "exc", None) or inner.__cause__ or inner.__context__
    return None


def kinematic_part(root: Any, name: str, where: str) -> Any:
    """Copy the links and joints of a robot, checked, in the form `urdf_parser_py` reads without a word.

    Args:
        root: The root element of the file.
        name: Name of the robot where the file gives none.
        where: The file, for messages.

    Raises:
        InvalidRobot: Not a robot, or a joint that cannot be read.
    """
    with importing:
        from lxml import etree

    tag = etree.QName(root).localname
    if tag != "robot":
        raise InvalidRobot(f"{where}: not a robot: the root tag is <{tag}>, expected <robot>")
    if next(root.iter(f"{{{_XACRO}}}*"), None) is not None:
        raise InvalidRobot(f"{where}: the file holds xacro commands; name it .xacro to have them expanded")
    space = root.tag.removesuffix("robot")

    robot = etree.Element("robot", name=root.get("name") or name)
    for noun in ("link", "joint"):
        require_few(sum(1 for _ in root.iterchildren(space + noun)), f"{noun}s", MOST_LINKS, where)
    for link in root.iterchildren(f"{space}link"):
        etree.SubElement(robot, "link", name=_name(link, "link", where))
    for joint in root.iterchildren(f"{space}joint"):
        _copy_joint(joint, etree.SubElement(robot, "joint"), space, where)
    return robot


def joint_velocities(root: Any) -> dict[str, float]:
    """How fast joints may go by the file, by name, [rad/s] or [m/s]; those of which it says nothing are left out.

    The format demands a number of whoever writes a limit, so 0 stands where nobody knew one. Poses do not depend on it: what
    is below 0 or no number says nothing either, and `soundness` tells of it.
    """
    space, found = root.tag.removesuffix("robot"), {}
    for joint in root.iterchildren(f"{space}joint"):
        limit = joint.find(f"{space}limit")
        try:
            velocity = float("nan" if limit is None else limit.get("velocity", "nan"))
        except ValueError:
            continue
        if 0 < velocity < math.inf:
            found[str(joint.get("name"))] = velocity
    return found


def soft_limits(root: Any, where: str) -> dict[str, tuple[float, float]]:
    """Read the soft limits of joints, ``<safety_controller soft_lower_limit=… soft_upper_limit=…>``.

    URDF takes 0 for a missing attribute. With a `<safety_controller k_velocity=…>` alone that would hold the joint at 0, and
    tools that fill in defaults write 0 0 there. So a missing attribute is no limit here, and neither is 0 0.

    Args:
        root: The root element of the file.
        where: The file, for messages.

    Returns:
        By name of the joint: lower and upper soft limit, [rad] or [m]; infinite where there is none.

    Raises:
        InvalidRobot: Several safety controllers in a joint, or a limit that is not a finite number.
    """
    space, found = root.tag.removesuffix("robot"), {}
    for joint in root.iterchildren(f"{space}joint"):
        controllers = joint.findall(f"{space}safety_controller")
        here = f"{where}: joint {joint.get('name')!r}"
        if len(controllers) > 1:
            raise InvalidRobot(f"{here}: {len(controllers)} <safety_controller> elements, expected one")
        for controller in controllers:
            given = _checked_attributes(controller, "safety_controller", here)
            lower = float(given.get("soft_lower_limit", -math.inf))
            upper = float(given.get("soft_upper_limit", math.inf))
            if not lower == upper == 0.0:
                found[str(joint.get("name"))] = (lower, upper)
    return found


def _copy_joint(joint: Any, copy: Any, space: str, where: str) -> None:
    with importing:
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
