"""Reduce a URDF or xacro file to its kinematics.

`urdf_parser_py` silently fills gaps and prints a complaint on stderr about every unknown tag. So the file is reduced and
checked here first; the result cannot be misread and refers to no mesh.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import io
import math
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import IO, Any
from xml.parsers import expat

from kinseek.errors import InvalidRobot, suggest
from kinseek.support.forks import finish_first, importing
from kinseek.support.interrupts import raise_of_handler

from .expressions import MOST_DIGITS, MOST_ENTRIES, MOST_LETTERS, Refused, entries, evaluate
from .files import MOST_BYTES, MOST_LINKS, file_bytes, require_few
from .packages import is_planted

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")

_XACRO = "http://www.ros.org/wiki/xacro"

_READ = ("origin", "parent", "child", "axis", "limit", "mimic")
"""Elements of a joint that define its pose and motion."""

_ENCODINGS = re.compile(
    r"utf-?8|utf-?16(le|be)?|(us-)?ascii|iso[-_]?8859-\d+|latin-?\d+|(windows-|cp)125\d|koi8-[ru]|"
    r"gb2312|gbk|gb18030|big5|shift[-_]jis|euc-(jp|kr|tw|cn)",
    re.IGNORECASE,
)
"""Encodings in which markup is written in one way only, or that readers without encodings cannot read at all. In others,
such as UTF-7, a comment can end where neither these readers, those of ROS and MuJoCo, nor an editor see its end."""

_XACRO_LOCK = threading.RLock()
"""Lock for expanding one file at a time, since xacro keeps its state in its module."""
finish_first(_XACRO_LOCK)
_LOST_PACKAGE = re.compile(r"Package not found: (\S+)")
"""Message of xacrodoc, wrapped by xacro."""
_MOST_STEPS, _MOST_LETTERS, _MOST_NESTED = 50_000, 2**20, 32
"""Most elements that xacro may expand, longest value, and deepest nesting of includes and of brackets in YAML."""
_MOST_PARAMETERS = 256
"""Most parameters of one macro: xacro searches for each of them among all."""
_MOST_WORK = 2**25
"""Most units of work of one expansion. A character of a value is one unit; slower operations count as more units.

The counts below follow from measured times: a file that uses all its units takes about 3 s at most."""
_NODE, _TEXT, _FORMULA, _YAML = 100, 64, 64, 192
"""Units of an element, attribute or comment that is read or copied; of a value that is examined, besides its characters; of
a character of an expression; of a byte of YAML."""
_FILE, _PATTERN, _MOVED = 2**14, 2**18, 4
"""Units of a file that is opened, and of a folder that is searched for a pattern; number of siblings that are passed in one
unit when an element is inserted among them."""
_PARAMETER = re.compile(
    r"""^\s*([^\s:=]+?)\s*:?=\s*(\^\|?)?(\$\{.*?\}|\$\(.*?\)|(?:'.*?'|".*?"|[^\s'"]+)++|)(?:\s+|$)(.*)"""
)
"""Parses a parameter of a macro and the rest, as xacro reads them. xacro's own expression tries exponentially many ways to
divide a default; this one (`++`) only tries the first."""
_Spend = Callable[[int, str], None]
"""Function that counts units of work, and raises with their purpose if there are too many."""
_NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3},
    "axis": {"xyz": 3},
    "limit": {"lower": 1, "upper": 1},
    "safety_controller": {"soft_lower_limit": 1, "soft_upper_limit": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}
"""Number of values of each attribute."""

_REQUIRED = {"parent": "link", "child": "link", "axis": "xyz", "mimic": "joint"}


def root_element(text: bytes, where: str) -> Any:
    """Parse XML without comments, processing instructions, default namespaces and the namespace of its root.

    Readers of ROS know no namespaces: an element without a prefix means the same in each of them.

    Raises:
        InvalidRobot: The XML is broken, or uses an entity that is another file; the message contains the parser's own, with
            the line. Or readers without encodings or namespaces
            would read something else.
    """
    with importing:
        from lxml import etree

    # Not huge_tree, which would lift the parser's limits on depth and on entities made of entities.
    parser = etree.XMLParser(
        remove_comments=True, remove_pis=True, resolve_entities="internal", no_network=True
    )
    try:
        root = etree.fromstring(text, parser)
    except (etree.XMLSyntaxError, LookupError) as error:  # An unknown encoding raises LookupError.
        raise InvalidRobot(f"{where}: broken XML: {getattr(error, 'msg', None) or error}") from None
    encoding = root.getroottree().docinfo.encoding or "UTF-8"
    if _ENCODINGS.fullmatch(encoding) is None:
        raise InvalidRobot(f"{where}: the encoding {encoding!r:.100} is not read; write the file in UTF-8")
    own = etree.QName(root).namespace
    for element in root.xpath("descendant-or-self::*[namespace-uri()]"):
        name = etree.QName(element)
        foreign = element.prefix not in (None, root.prefix)
        if foreign and name.namespace == own != _XACRO:
            raise InvalidRobot(
                f"{where}: <{element.prefix}:{name.localname}> in line {element.sourceline} is of the namespace of the "
                "root, and readers of ROS know no namespaces; write it without a prefix, or take it out"
            )
        if (name.namespace == own and not foreign) or (element.prefix is None and name.namespace != _XACRO):
            element.tag = name.localname
    return root


class _Arguments(dict[str, str]):
    """Arguments of a xacro file; the class records which of them the file requests."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.requested: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.requested.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.requested.add(name)
        return super().__getitem__(name)


def expand_xacro(
    path: Path,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> bytes:
    """Expand a xacro file into URDF text.

    Args:
        path: The file.
        args: Values of its arguments, by name; booleans are written as xacro reads them.
        packages: Folders of ROS packages, by name. Others are searched in the parent folders of the file, and where ROS
            keeps them.
        trusted: Whether Python may evaluate its expressions. Otherwise `expressions` does, and the environment is not read.

    Raises:
        InvalidRobot: The file is missing, the file has no such argument, a package is not a folder, or xacro cannot process
            the file; the message is then xacro's own.
    """
    file_bytes(path)
    arguments = _Arguments({str(name): _as_xacro(value) for name, value in (args or {}).items()})
    text = _expanded(path, arguments, _folders(packages or {}), trusted)
    for name in args or {}:
        if name not in arguments.requested:
            raise InvalidRobot(f"{path}: {suggest(str(name), arguments.requested, 'argument')}")
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
        from xacrodoc import packages
        from xacrodoc.xacrodoc import xacro

    # xacro and xacrodoc keep their state in modules, so only one file is expanded at a time.
    with _XACRO_LOCK, _restricted_xacro(path) as spend, contextlib.ExitStack() as stack:
        if not trusted:
            stack.enter_context(_computed_xacro(path, spend))
        before = packages._finder
        try:
            # Packages found for one file must not be used for the next file: use a copy.
            packages._finder = packages.PackageFinder()
            packages._finder.finder_funcs[:] = before.finder_funcs
            packages._finder.package_cache.update(before.package_cache | folders)
            packages._finder.finder_funcs.insert(0, (_finder_above(path), packages.PackageNotFoundError))
            # Once: xacrodoc repeats it until nothing changes, and so would evaluate $${…}, which stands for ${…}.
            document = xacro.parse(None, str(path))
            xacro.process_doc(document, mappings=arguments)
            return bytes(document.toxml(encoding="utf-8"))
        except InvalidRobot:
            raise
        except Exception as error:  # xacro evaluates expressions of the file, which may raise anything.
            raise_of_handler(getattr(error, "exc", None) or error)  # xacro's own errors wrap others.
            refused = _refusal(error)
            if refused is not None:
                raise refused from None
            why = str(error) or type(error).__name__
            if lost := _LOST_PACKAGE.search(why):
                why = f"package {lost[1]!r} is not found; say where it is with packages={{name: folder}}, in a shell "
                why += "--package NAME=FOLDER"
            raise InvalidRobot(f"{path}: xacro failed: {why}") from None
        finally:
            packages._finder = before


def _finder_above(path: Path) -> Callable[[str], str]:
    """Return a function that finds a package in the folders above a file.

    It does what `packages.walk_up_from` of xacrodoc does, but leaves out manifests that another user may have planted:
    files of a package may be run.
    """
    from xacrodoc import packages

    def find(package: str) -> str:
        for folder in path.resolve().parents[:-1]:
            manifest, old = folder / "package.xml", folder / "manifest.xml"
            if manifest.exists() and not is_planted(manifest, path):
                with packages.open(manifest) as file:
                    names = packages.minidom.parse(file).getElementsByTagName("name")
                if len(names) != 1:
                    raise InvalidRobot(f"{manifest}: {len(names)} <name> elements, expected one")
                if names[0].firstChild is not None and names[0].firstChild.data == package:
                    return str(folder)
            # Manifests of rosbuild contain no name.
            if old.exists() and not is_planted(old, path):
                return str(folder)
        raise packages.PackageNotFoundError(package)

    return find


@contextlib.contextmanager
def _restricted_xacro(path: Path) -> Iterator[_Spend]:
    """Make xacro read only regular files of limited size, print nothing, and stop if the work grows too large.

    xacro looks these functions up in its own modules at each call. `sys.stdout` and `sys.stderr` are not replaced, since all
    threads print there.
    """
    from xacrodoc import packages
    from xacrodoc.xacrodoc import xacro

    left, steps, work = MOST_BYTES, 0, 0
    own = SimpleNamespace(**vars(xacro))

    def spend(units: int, what: str) -> None:
        nonlocal work
        work += units
        require_few(
            work, "units of work", _MOST_WORK, f"{path}: xacro has too much to do, at last with {what}"
        )

    def open_file(name: Any, mode: str = "r") -> IO[Any]:
        """Return a whole file as `open` opens it, but what was checked: another file may have the name by now."""
        nonlocal left
        require_few(
            len(xacro.filestack), "files, each included by the one before", _MOST_NESTED, f"{path}: xacro"
        )
        spend(_FILE, "files that are opened")
        if not Path(name).exists():  # xacro itself gives the best message about a missing file.
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(name))
        content = file_bytes(Path(name), left)
        left -= len(content)
        return io.BytesIO(content) if "b" in mode else io.TextIOWrapper(io.BytesIO(content))

    def parse(given: Any, name: Any = None) -> Any:
        if given is None and Path(name).exists():
            with open_file(name) as file:
                given = file.read()
        if isinstance(given, str):
            _count_nodes(given, spend, str(path if name is None else name))
        return own.parse(given, name)

    def eval_all(node: Any, *rest: Any) -> Any:
        nonlocal steps
        steps += 1
        require_few(steps, "elements to expand", _MOST_STEPS, f"{path}: xacro")
        if node.parentNode is None and node.tagName != "xacro:macro":  # The node is a copy of a block.
            spend(_units_of(node), "copies of blocks")
        return own.eval_all(node, *rest)

    def eval_text(text: str, symbols: Any) -> Any:
        # For each dollar sign xacro copies the rest of the text.
        spend(_TEXT + len(text) * (1 + text.count("$")), "values")
        value = own.eval_text(text, symbols)
        if isinstance(value, str):
            require_few(len(value), "letters in one value", _MOST_LETTERS, f"{path}: xacro")
            spend(len(value), "values")
        else:
            spend(_TEXT * entries(value, MOST_ENTRIES), "values")  # The value may be written as text.
        return value

    def eval_extension(text: str) -> Any:
        # A property can contain many of these; xacro would insert the same value for each of them.
        require_few(text.count("$("), "$(…) in one", 1, f"{path}: xacro: {text[:80]!r}")
        return own.eval_extension(text)

    def is_valid_name(name: str) -> bool:
        # Python's parser examines it.
        require_few(len(name), "letters in the name of a property", MOST_LETTERS, f"{path}: xacro")
        return bool(own.is_valid_name(name))

    def resolve_macro(*arguments: Any) -> Any:
        """Count the body of a macro, which xacro copies next."""
        found = own.resolve_macro(*arguments)
        require_few(len(found[2].params), "parameters of one macro", _MOST_PARAMETERS, f"{path}: xacro")
        spend(_units_of(found[2].body), "copies of macros")
        return found

    def parse_macro_arg(text: str) -> Any:
        spend(_TEXT + len(text), "parameters of macros")
        return own.parse_macro_arg(text)

    def replace_node(node: Any, by: Any, content_only: bool = False) -> Any:
        new = by if isinstance(by, list) else [] if by is None else [by]
        moved = sum(len(one.childNodes) for one in new) if content_only else len(new)
        # Each of them is inserted by a search through all siblings present by then.
        spend((1 + moved) * (moved + len(node.parentNode.childNodes)) // _MOVED, "elements of one parent")
        return own.replace_node(node, by, content_only)

    def matches(pattern: str) -> list[str]:
        if re.search(r"[*?[]", os.path.dirname(pattern)):
            raise InvalidRobot(
                f"{path}: xacro: the include {pattern!r} has *, ? or [ in the name of a folder, expected them in the "
                "name of the file alone"
            )
        spend(_PATTERN, "patterns of includes")
        return glob.glob(pattern)

    instead = {
        "open": open_file,
        "print": lambda *words, **options: None,
        "parse": parse,
        "eval_all": eval_all,
        "eval_text": eval_text,
        "eval_extension": eval_extension,
        "is_valid_name": is_valid_name,
        "resolve_macro": resolve_macro,
        "parse_macro_arg": parse_macro_arg,
        "re_macro_arg": _PARAMETER,
        "replace_node": replace_node,
        # Comments are not read, and removing one among many takes long.
        "remove_previous_comments": lambda node: None,
        "glob": SimpleNamespace(glob=matches),
    }
    # Package manifests are beside the file, and may be untrusted as well.
    manifests = {"open": open_file, "minidom": SimpleNamespace(parse=lambda file: parse(file.read()))}
    changed = ((xacro, instead), (xacro.color, {"print": instead["print"]}), (packages, manifests))
    before = [{name: vars(module)[name] for name in new if name in vars(module)} for module, new in changed]
    try:
        for module, new in changed:
            vars(module).update(new)
        # Otherwise relative includes would be searched in the working directory.
        xacro.init_stacks(str(path))
        yield spend
    finally:
        for (module, new), old in zip(changed, before, strict=True):
            for name in new:
                vars(module).pop(name, None)
            vars(module).update(old)


def _count_nodes(text: str, spend: _Spend, where: str) -> None:
    """Count the content of an XML tree, with entities expanded, before it is built.

    Raises:
        InvalidRobot: The document type is long: Python's parser crashes on one with many brackets. Or an entity is another
            file, which Python's parser would leave out.
    """
    began = 0

    def begin(*parts: Any) -> None:
        nonlocal began
        began = parser.CurrentByteIndex

    def end() -> None:
        require_few(parser.CurrentByteIndex - began, "bytes in the document type", MOST_LETTERS, where)

    def count(*letters: str) -> None:
        spend(_NODE + sum(map(len, letters)), "elements, attributes and comments")

    def start(name: str, attributes: dict[str, str]) -> None:
        count(name)
        for attribute, value in attributes.items():
            count(attribute, value)

    def refuse(*_: Any) -> int:
        raise InvalidRobot(
            f"{where}: it uses an entity that is another file, expected all of it in the file itself"
        )

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.ExternalEntityRefHandler = refuse
    parser.StartDoctypeDeclHandler, parser.EndDoctypeDeclHandler = begin, end
    parser.StartElementHandler = start
    parser.CommentHandler = parser.CharacterDataHandler = parser.ProcessingInstructionHandler = count
    parser.StartCdataSectionHandler = count
    with contextlib.suppress(expat.ExpatError):  # The code that builds the tree reports it.
        parser.Parse(text, True)


def _units_of(node: Any) -> int:
    """Return the units of work to copy an element with all its content, and to write the copy."""
    left, units = [node], 0
    while left:
        one = left.pop()
        units += _NODE + len(one.nodeName) + len(one.nodeValue or "")
        for name, value in one.attributes.items() if one.attributes else ():
            units += _NODE + len(name) + len(value)
        left.extend(one.childNodes)
    return units


def _yaml_content(text: bytes, units: Any, where: str) -> Any:
    """Read YAML as xacro does, unless it is large with its aliases and merges expanded.

    Args:
        text: The file.
        units: xacro's tags for units, such as ``!degrees``.
        where: The file, for messages.

    Raises:
        InvalidRobot: The file has a number with too many digits, too many entries when expanded, or too many brackets
            around one value.
        yaml.YAMLError: The text is not YAML.
    """
    import yaml  # type: ignore[import-untyped]

    class Loader(yaml.SafeLoader):  # type: ignore[misc]
        """A separate class, so that the tags for units are not added to the loader of other programs."""

        def fetch_flow_collection_start(self, token: Any) -> None:
            # At each word PyYAML goes through all brackets around it.
            require_few(self.flow_level + 1, "brackets around one value", _MOST_NESTED, where)
            super().fetch_flow_collection_start(token)

    for unit in units:
        Loader.add_constructor(unit.value.tag, unit.constructor)
    sizes: dict[Any, int] = {}

    def written(node: Any) -> int:
        """Return the number of entries with all aliases expanded; a merge counts as the map that it refers to."""
        if node not in sizes:
            # The value until it is known: a list that contains itself never ends.
            sizes[node] = MOST_ENTRIES + 1
            if isinstance(node, yaml.ScalarNode):
                if node.tag.endswith((":int", ":float")):
                    require_few(len(node.value), "digits of one number", MOST_DIGITS, where)
                sizes[node] = 1 + len(node.value) // 64
            else:
                inner = (
                    one for entry in node.value for one in (entry if isinstance(entry, tuple) else (entry,))
                )
                sizes[node] = min(1 + sum(map(written, inner)), MOST_ENTRIES + 1)
        return sizes[node]

    loader = Loader(text)
    try:
        node = loader.get_single_node()
        if node is None:
            return None
        require_few(written(node), "entries of a YAML file", MOST_ENTRIES, where)
        return loader.construct_document(node)
    finally:
        loader.dispose()


@contextlib.contextmanager
def _computed_xacro(path: Path, spend: _Spend) -> Iterator[None]:
    """Replace Python's `eval` and the environment for xacro, since the file may be untrusted."""
    from xacro import substitution_args  # type: ignore[import-untyped]
    from xacrodoc.xacrodoc import xacro

    contents: dict[str, Any] = {}

    def load_yaml(name: str) -> Any:
        # All callers share one content: expressions that are evaluated here cannot change it.
        file = xacro.abs_filename_spec(name)
        if file not in contents:
            with xacro.open(file, "rb") as opened:
                text = opened.read()
            spend(_YAML * len(text), "YAML files")
            xacro.filestack.append(file)
            try:
                contents[file] = _yaml_content(text, xacro.ConstructUnits, f"{path}: {name}")
            finally:
                xacro.filestack.pop()
        return contents[file]

    def compute(expression: str, names: Any, functions: Mapping[str, Any]) -> Any:
        spend(_FORMULA * len(expression), "expressions")
        try:
            return evaluate(expression, names, functions, lambda units: spend(units, "expressions"))
        except Refused as refused:
            raise InvalidRobot(
                f"{path}: xacro: {expression.strip()[:80]!r} holds {refused}; in a file that is not trusted only "
                "simple expressions are computed. If you trust the file, give trusted=True"
            ) from None

    def safe_eval(expression: str, names: Any, inner: Any = None) -> Any:
        arguments = xacro.substitution_args_context["arg"]
        own = {"load_yaml": load_yaml, "dotify": lambda value: value, "abs_filename": xacro.abs_filename_spec}
        own["arg"] = lambda name: arguments[name]
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

    # xacro has no hook for this, so its functions are replaced while the lock is held.
    original = xacro.safe_eval
    before = {name: getattr(substitution_args, name) for name in ("_eval", "_eval_env", "_eval_optenv")}
    try:
        xacro.safe_eval = safe_eval
        substitution_args._eval, substitution_args._eval_env = eval_extension, unknown
        substitution_args._eval_optenv = lambda name, default="": default
        yield
    finally:
        xacro.safe_eval = original
        for name, function in before.items():
            setattr(substitution_args, name, function)


def _refusal(error: BaseException) -> InvalidRobot | None:
    """Return kinseek's own rejection, which xacro may have wrapped into an error of its own."""
    inner: BaseException | None = error
    seen: set[int] = set()
    while inner is not None and id(inner) not in seen:
        if isinstance(inner, InvalidRobot):
            return inner
        seen.add(id(inner))
        inner = getattr(inner, "exc", None) or inner.__cause__ or inner.__context__
    return None


def kinematic_part(root: Any, name: str, where: str) -> Any:
    """Copy the links and joints of a robot, checked, in a form that `urdf_parser_py` reads without messages.

    Args:
        root: The root element of the file.
        name: Name of the robot, if the file has none.
        where: The file, for messages.

    Raises:
        InvalidRobot: The file is not a robot, or a joint cannot be read.
    """
    with importing:
        from lxml import etree

    if root.tag != "robot":
        raise InvalidRobot(f"{where}: not a robot: the root tag is <{root.tag}>, expected <robot>")
    # xacro knows its commands by their prefix, and many files name another address than it does.
    if root.xpath(f"descendant::*[namespace-uri() = '{_XACRO}' or starts-with(name(), 'xacro:')]"):
        raise InvalidRobot(f"{where}: the file has xacro commands; rename it to .xacro to expand them")
    # urdfdom reads it in files of version 1.1 and later.
    for origin in root.iter("origin"):
        if origin.get("quat_xyzw") is not None:
            raise InvalidRobot(
                f"{where}: an <origin> in line {origin.sourceline} has quat_xyzw, which is not supported, expected rpy"
            )

    robot = etree.Element("robot", name=root.get("name") or name)
    for noun in ("link", "joint"):
        require_few(sum(1 for _ in root.iterchildren(noun)), f"{noun}s", MOST_LINKS, where)
    for link in root.iterchildren("link"):
        etree.SubElement(robot, "link", name=_name(link, "link", where))
    for joint in root.iterchildren("joint"):
        _copy_joint(joint, etree.SubElement(robot, "joint"), where)
    return robot


def joint_velocities(root: Any) -> dict[str, float]:
    """Return the joint speed limits of the file, by name, [rad/s] or [m/s]; joints without one are left out.

    The format requires a number in every limit, so files contain 0 for an unknown one. Poses do not depend on it: a value
    that is negative or invalid counts as missing too, and `soundness` reports it.
    """
    found = dict[str, float]()
    for joint in root.iterchildren("joint"):
        limit = joint.find("limit")
        try:
            velocity = float("nan" if limit is None else limit.get("velocity", "nan"))
        except ValueError:
            continue
        if 0 < velocity < math.inf:
            found[str(joint.get("name"))] = velocity
    return found


def soft_limits(root: Any, where: str) -> dict[str, tuple[float, float]]:
    """Read the soft limits of joints, ``<safety_controller soft_lower_limit=… soft_upper_limit=…>``.

    URDF defines 0 for a missing attribute. With a `<safety_controller k_velocity=…>` alone this would fix the joint at 0,
    and tools that fill in defaults write 0 0 there. So a missing attribute is not a limit here, and neither is 0 0.

    Args:
        root: The root element of the file.
        where: The file, for messages.

    Returns:
        Lower and upper soft limit by name of the joint, [rad] or [m]; infinite if there is none.

    Raises:
        InvalidRobot: A joint has several safety controllers, or a limit is not a finite number.
    """
    found = dict[str, tuple[float, float]]()
    for joint in root.iterchildren("joint"):
        controllers = joint.findall("safety_controller")
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


def _copy_joint(joint: Any, copy: Any, where: str) -> None:
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
    for tag in _READ:
        found = joint.findall(tag)
        if len(found) > 1:
            raise InvalidRobot(f"{here}: {len(found)} <{tag}> elements, expected one")
        if not found:
            if tag in ("parent", "child"):
                raise InvalidRobot(f"{here}: no <{tag}>")
            continue
        attributes = _checked_attributes(found[0], tag, here)
        if tag == "limit":
            if not {"lower", "upper"} <= attributes.keys():
                continue  # The parser would read a missing bound as 0; a missing limit is found later.
            attributes |= {"effort": "0", "velocity": "0"}
        etree.SubElement(copy, tag, attributes)


def _checked_attributes(element: Any, tag: str, here: str) -> dict[str, str]:
    required = _REQUIRED.get(tag)
    if required and not element.get(required):
        raise InvalidRobot(f"{here}: <{tag}> has no {required}")
    checked = {required: element.get(required)} if required else {}
    for attribute, count in _NUMBERS.get(tag, {}).items():
        text = element.get(attribute)
        if text is not None:
            _check_numbers(text, count, f"{here}: <{tag}> {attribute}={text!r}")
            checked[attribute] = text.strip()
    return checked


def _check_numbers(text: str, count: int, what: str) -> None:
    words = text.split()
    if len(words) != count:
        raise InvalidRobot(f"{what}: {len(words)} values, expected {count}")
    for word in words:
        try:
            value = float(word.replace("_", "?"))  # Python alone would accept 1_000.
        except ValueError:
            raise InvalidRobot(f"{what}: {word!r} is not a number") from None
        if not math.isfinite(value):
            raise InvalidRobot(f"{what}: {word!r} is not finite")


def _name(element: Any, tag: str, where: str) -> str:
    name = element.get("name")
    if not name:
        raise InvalidRobot(f"{where}: a <{tag}> in line {element.sourceline} has no name")
    return str(name)
