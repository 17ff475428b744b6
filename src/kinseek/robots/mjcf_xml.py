"""Reduce an MJCF file to its kinematics: bodies, frames, joints, sites and their defaults.

MuJoCo's own reader takes the text without checks: names that are not UTF-8, invalid numbers, counts that fill the memory,
files that are pipes. So the file is reduced and checked here first, and its includes are inserted. MuJoCo gets the result,
with every element still in its line. An unknown tag is kept, since MuJoCo gives the best message about it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple
from xml.sax.saxutils import quoteattr

from kinseek.errors import InvalidRobot

from .files import MOST_BYTES, MOST_LINKS, file_bytes, require_few, require_here
from .xml_files import root_element

_SECTIONS = {
    *("option", "size", "visual", "statistic", "extension", "custom", "contact", "deformable", "equality"),
    *("tendon", "actuator", "sensor", "keyframe"),
}
"""Sections beside the bodies that do not affect their poses."""
_DEFAULTS = {
    *(
        "mesh",
        "material",
        "geom",
        "camera",
        "light",
        "pair",
        "equality",
        "tendon",
        "general",
        "motor",
        "position",
    ),
    *("velocity", "intvelocity", "damper", "cylinder", "muscle", "adhesion", "dcmotor", "plugin"),
}
"""Defaults of removed elements."""
_ASSETS = {"mesh", "hfield", "skin", "texture", "material"}
_IN_BODIES = {"inertial", "geom", "camera", "light", "composite", "flexcomp", "plugin"}
_DROPPED = {
    "mujoco": _SECTIONS,
    "default": _DEFAULTS,
    "asset": _ASSETS,
    "worldbody": _IN_BODIES,
    "body": _IN_BODIES,
    "frame": _IN_BODIES,
    "replicate": _IN_BODIES,
}
"""Removed children of each element: those that kinematics does not need."""

_INCLUDE = "include"
"""The element that stands for the content of another file."""

_NUMBERS = ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "axis", "range", "ref", "offset")
"""Attributes that define a pose or a limit."""
_WORDS = {"name", "class", "childclass", "model", "body", "file", "prefix", "content_type"}
"""Attributes that are names: a name may be "nan"."""

_UNUSED = {"user", "material"}
"""Removed attributes: any number of numbers, which MuJoCo copies with their element; and the material of a site, whose asset
is removed too."""

_COUNTED = {"body", "joint", "freejoint", "site", "frame", "replicate", "attach", "default", "model"}
"""Elements that take memory in MuJoCo, even if they are empty."""

MOST_LETTERS, MOST_OF_ALL = 1_000, 2**20
"""Most letters of one attribute, and of the attributes of all counted elements, copies counted. MuJoCo compares each name
with all others, letter by letter."""


@dataclass
class Reduced:
    """A model for MuJoCo, and the models that it attaches."""

    text: str
    attached: dict[str, bytes] = field(default_factory=dict)
    """Reduced text of each attached model, by its name here."""


def reduced(path: Path) -> Reduced:
    """Read an MJCF file with all its includes, reduced to its kinematics.

    Raises:
        InvalidRobot: A file is missing, too large or broken, a number is not finite, or elements are too many or nested too
            deeply.
    """
    reader = _Reader()
    try:
        text, _, size = reader.model(path, ())
    except RecursionError:
        raise InvalidRobot(f"{path}: elements or files are nested too deeply") from None
    require_few(size.elements, "bodies, joints and other elements, copies counted", MOST_LINKS, str(path))
    require_few(size.letters, "letters in names and other attributes, copies counted", MOST_OF_ALL, str(path))
    return Reduced(text, reader.attached)


class _Size(NamedTuple):
    """What a model takes in MuJoCo, with all copies."""

    elements: int
    """Number of elements of `_COUNTED`."""
    letters: int
    """Letters of their attributes, with what copies add to names."""


MOST_MODELS = 1000
"""Most models: each copy of an attached model is read again."""


_NAME = "MuJoCo Model"
"""MuJoCo's name of a model without one."""


def _real(path: Path) -> str:
    """Return a path with its links resolved, as far as possible: `Path.resolve` raises RuntimeError for a link to itself."""
    return os.path.realpath(path)


class _Reader:
    """Reads one file, and those that it includes or attaches."""

    def __init__(self) -> None:
        self.left = MOST_BYTES
        self.attached: dict[str, bytes] = {}
        self.models = 0
        """Number of models that were read; each attachment counts."""

    def model(self, path: Path, above: tuple[str, ...]) -> tuple[str, str, _Size]:
        """Return the text of a model, its name, and its size."""
        if _real(path) in above:
            raise InvalidRobot(f"{path}: the model attaches itself")
        self.models += 1
        require_few(self.models, "models, copies counted", MOST_MODELS, str(path))
        root = self._root(path)
        if (
            root.tag != "mujoco"
        ):  # MuJoCo also reads URDF, with case-insensitive tags, and the meshes it refers to.
            raise InvalidRobot(f"{path}: the root of a model is {root.tag!r:.100}, expected 'mujoco'")
        self._include(root, path, path, {_real(path)})
        sizes = self._attach(root, path, (*above, _real(path)))
        size = _size(root, sizes)
        out: list[str] = []
        _write(root, None, str(path), out, [1])
        return "".join(out), root.get("model", _NAME), size

    def _root(self, path: Path) -> Any:
        text = file_bytes(path, self.left)
        self.left -= len(text)
        root = root_element(text, str(path))
        for element in root.iter("*"):
            element.tag = element.tag.rpartition("}")[2]  # MuJoCo does not support namespaces.
            if element.tag != _INCLUDE and element.tag.lower() == _INCLUDE:
                # MuJoCo itself would open the file, whatever it is.
                raise InvalidRobot(
                    f"{path}: <{element.tag}> in line {element.sourceline}, expected <{_INCLUDE}> in small letters"
                )
        return root

    def _include(self, root: Any, path: Path, main: Path, seen: set[str]) -> None:
        """Replace every <include> by the children of the included file; `main` is the file of the model."""
        for element in list(
            root.iterfind(f".//{_INCLUDE}")
        ):  # The root of an included file is only a container.
            name = element.get("file")
            if not name:
                raise InvalidRobot(f"{path}: <include> in line {element.sourceline} has no file")
            file = self._find(name, main, path)
            if _real(file) in seen:
                raise InvalidRobot(f"{path}: file {name!r} is included twice")
            seen.add(_real(file))
            inner = self._root(file)
            self._include(inner, file, main, seen)
            parent, place = element.getparent(), element.getparent().index(element)
            parent[place : place + 1] = list(inner)

    def _attach(self, root: Any, path: Path, above: tuple[str, ...]) -> dict[str, _Size]:
        """Read the models that the file attaches, and return the size of each."""
        sizes = {}
        for element in root.iterfind("asset/model"):
            name = element.get("file")
            if not name:
                raise InvalidRobot(f"{path}: <model> in line {element.sourceline} has no file")
            text, own_name, size = self.model(self._find(name, path, path), above)
            key = f"attached_{len(self.attached)}.xml"
            self.attached[key] = text.encode()
            element.set("file", key)
            if element.get("name") is None:
                element.set("name", own_name)
            called = element.get("name")
            if called in sizes:  # MuJoCo attaches the first of them.
                raise InvalidRobot(f"{path}: two models are called {called!r:.100}, expected different names")
            sizes[called] = size
        for element in root.iter("attach"):
            if element.get("model") is None:
                # MuJoCo copies a body of this file, with the copies in it: each level may double them.
                raise InvalidRobot(
                    f"{path}: <attach> in line {element.sourceline} has no model; copies of a body of the same file are not "
                    "read, write it as a model in another file"
                )
        return sizes

    def _find(self, name: str, main: Path, beside: Path) -> Path:
        """Return the path of a file; like MuJoCo, look beside the file of the model first."""
        require_here(name, main.parent)
        try:
            places = [main.parent / name, beside.parent / name]
            return next((place for place in places if place.exists()), places[0])
        except (OSError, ValueError) as error:
            raise InvalidRobot(f"{beside}: {name!r} is not a valid file name: {error}") from None


def _size(root: Any, attached: dict[str, _Size]) -> _Size:
    """Return the size of a model, with the copies that `replicate` and `attach` make."""
    # MuJoCo also reads models that are never attached.
    elements, letters = (sum(each[i] for each in attached.values()) for i in range(2))
    stack = [(root, 1, 0)]
    while stack:
        element, times, added = stack.pop()
        if element.tag == "replicate":
            times *= _count(element.get("count"))
            added += len(element.get("sep", ""))  # It becomes a part of each name inside.
        own = added + sum(len(value) for name, value in element.items() if name not in _UNUSED)
        if element.tag in _COUNTED:
            elements, letters = elements + times, letters + times * own
        if element.tag == "attach":
            inner = attached.get(element.get("model"), _Size(0, 0))
            elements += times * inner.elements
            letters += times * (inner.letters + own * inner.elements)
        stack += [(child, times, added) for child in _elements(element)]
    return _Size(elements, letters)


def _count(text: str | None) -> int:
    try:
        return max(0, int(float(text or "1")))
    except (ValueError, OverflowError):
        return 1  # MuJoCo rejects it.


def _elements(element: Any) -> Iterator[Any]:
    """Iterate over children that are elements, without entities."""
    return (child for child in element if isinstance(child.tag, str))


def _write(element: Any, parent: str | None, where: str, out: list[str], line: list[int]) -> None:
    """Write the kept parts of an element, in its own line if possible."""
    if element.tag in _DROPPED.get(parent or "", ()):
        return
    if element.sourceline and element.sourceline > line[0]:
        out.append("\n" * (element.sourceline - line[0]))
        line[0] = element.sourceline
    _check_numbers(element, where)
    out.append(f"<{element.tag}")
    for name, value in element.items():
        if "{" in name or name in _UNUSED:
            continue
        require_few(
            len(value),
            f"letters in {name!r:.100} of <{element.tag}> in line {element.sourceline}",
            MOST_LETTERS,
            where,
        )
        out.append(f" {name}={quoteattr(value)}")
    out.append(">")
    for child in _elements(element):
        _write(child, element.tag, where, out, line)
    out.append(f"</{element.tag}>")


def _check_numbers(element: Any, where: str) -> None:
    for name, value in element.items():
        for word in value.split() if name not in _WORDS else ():
            try:
                number = float(word.partition("(")[0])  # C also reads nan(1).
            except ValueError:
                continue  # Not a number: MuJoCo reports it.
            # In attributes that kinematics does not use, MuJoCo accepts infinity. For NaN it prints a warning on the
            # terminal, past Python, and writes it to a file in the working folder.
            if math.isnan(number) or (name in _NUMBERS and math.isinf(number)):
                raise InvalidRobot(
                    f"{where}: <{element.tag}> in line {element.sourceline}: {name}={value!r}: {word!r} is not finite"
                )
