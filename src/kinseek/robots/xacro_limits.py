"""Limits on the work of xacro.

A few lines of xacro can expand to any size. So xacro reads only regular files here, prints nothing, and stops if the work
grows too large: its functions are replaced by functions that count first.
"""

from __future__ import annotations

import contextlib
import errno
import glob
import io
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import IO, Any
from xml.parsers import expat

from kinseek.errors import InvalidRobot

from .expressions import MOST_ENTRIES, MOST_LETTERS, entries
from .files import MOST_BYTES, file_bytes, require_few, require_here

_MOST_STEPS, _MOST_VALUE, MOST_NESTED = 50_000, 2**20, 32
"""Most elements that xacro may expand, longest value, and deepest nesting of includes and of brackets in YAML."""
_MOST_DEPTH = 256
"""Most elements around another one, itself included: for each namespace that is declared, some versions of Python go through
all of them. xacro itself needs three calls for each."""
_MOST_PARAMETERS = 256
"""Most parameters of one macro: xacro searches for each of them among all."""
_MOST_WORK = 2**25
"""Most units of work of one expansion. A character of a value is one unit; slower operations count as more units.

The counts below follow from measured times: a file that uses all its units takes about 3 s at most."""
_NODE, _TEXT, FORMULA, YAML = 100, 64, 64, 192
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
Spend = Callable[[int, str], None]
"""Function that counts units of work, and raises with their purpose if there are too many."""


Changes = tuple[ModuleType, dict[str, Any]]
"""A module, and the new values of some of its names."""


def limits(path: Path, folders: Iterable[str]) -> tuple[tuple[Changes, ...], Spend]:
    """Return what makes xacro read only regular files of limited size, print nothing, and stop if the work grows too large.

    xacro looks these functions up in its own modules at each call. `sys.stdout` and `sys.stderr` are not replaced, since all
    threads print there.

    Args:
        path: The file.
        folders: Folders of packages that the user named.

    Returns:
        The names to replace, and the function that counts work.
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
            len(xacro.filestack), "files, each included by the one before", MOST_NESTED, f"{path}: xacro"
        )
        spend(_FILE, "files that are opened")
        require_here(str(name), path, folders)
        if not Path(name).exists():  # xacro itself gives the best message about a missing file.
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), str(name))
        content = file_bytes(Path(name), left)
        left -= len(content)
        return io.BytesIO(content) if "b" in mode else io.TextIOWrapper(io.BytesIO(content))

    def parse(given: Any, name: Any = None) -> Any:
        if given is None:
            require_here(str(name), path, folders)
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
            require_few(len(value), "letters in one value", _MOST_VALUE, f"{path}: xacro")
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
        require_here(pattern, path, folders)
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
    return ((xacro, instead), (xacro.color, {"print": instead["print"]}), (packages, manifests)), spend


def _count_nodes(text: str, spend: Spend, where: str) -> None:
    """Count the content of an XML tree, with entities expanded, before it is built.

    Raises:
        InvalidRobot: Elements are nested too deep. The document type is long: Python's parser crashes on one with many
            brackets. Or an entity is another file, which Python's parser would leave out.
    """
    began = depth = 0

    def begin(*parts: Any) -> None:
        nonlocal began
        began = parser.CurrentByteIndex

    def end() -> None:
        require_few(parser.CurrentByteIndex - began, "bytes in the document type", MOST_LETTERS, where)

    def count(*letters: str) -> None:
        spend(_NODE + sum(map(len, letters)), "elements, attributes and comments")

    def start(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        require_few(depth, "elements within each other", _MOST_DEPTH, where)
        count(name)
        for attribute, value in attributes.items():
            count(attribute, value)

    def leave(name: str) -> None:
        nonlocal depth
        depth -= 1

    def refuse(*_: Any) -> int:
        raise InvalidRobot(
            f"{where}: it uses an entity that is another file, expected all of it in the file itself"
        )

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.ExternalEntityRefHandler = refuse
    parser.StartDoctypeDeclHandler, parser.EndDoctypeDeclHandler = begin, end
    parser.StartElementHandler, parser.EndElementHandler = start, leave
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
