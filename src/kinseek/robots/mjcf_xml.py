"""What kinematics needs of an MJCF file, and nothing else of it: bodies, frames, joints, sites and their defaults.

MuJoCo's own reader takes the text as it is: names that are no UTF-8, numbers that are no numbers, counts that fill the
memory, files that are pipes. So the file is reduced and checked here first, its includes put in place, and MuJoCo gets
what is left, every element still in its line. A tag that is not known stays: MuJoCo says best what it thinks of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

from kinseek.errors import InvalidRobot

from .files import MOST_BYTES, MOST_LINKS, file_bytes, require_few
from .urdf_xml import root_element

_SECTIONS = {
    *("option", "size", "visual", "statistic", "extension", "custom", "contact", "deformable", "equality"),
    *("tendon", "actuator", "sensor", "keyframe"),
}
"""What stands beside the bodies and does not say where they are."""
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
"""Defaults of what is dropped."""
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
"""Of each element: which of its children kinematics does not look at."""

_NUMBERS = ("pos", "quat", "euler", "axisangle", "xyaxes", "zaxis", "axis", "range", "ref", "offset")
"""Attributes that a pose or a limit is made of."""
_WORDS = {"name", "class", "childclass", "model", "body", "file", "prefix", "content_type"}
"""Attributes that are names: one may be called nan."""

_COUNTED = {"body", "joint", "freejoint", "site", "frame", "replicate", "attach", "default", "model"}
"""Elements that take memory in MuJoCo, also if nothing is in them."""


@dataclass
class Reduced:
    """A model that MuJoCo can be given, and the models that it attaches."""

    text: str
    attached: dict[str, bytes] = field(default_factory=dict)
    """Of each model that is attached: its name here, and its own reduced text."""


def reduced(path: Path) -> Reduced:
    """Read an MJCF file with everything that it includes, reduced to its kinematics.

    Raises:
        InvalidRobot: A file is missing, too large or broken, a number is not finite, or elements are too many or nested too
            deeply.
    """
    reader = _Reader(path.parent)
    try:
        text, size = reader.model(path, ())
    except RecursionError:
        raise InvalidRobot(f"{path}: elements or files are nested too deeply") from None
    require_few(size, "bodies, joints and other elements, copies counted", MOST_LINKS, str(path))
    return Reduced(text, reader.attached)


MOST_MODELS = 1000
"""Each copy of an attached model is read anew."""


class _Reader:
    """Reads one file, and those that it includes or attaches."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.left = MOST_BYTES
        self.attached: dict[str, bytes] = {}
        self.models = 0
        """Models that were read, each as often as it is attached."""

    def model(self, path: Path, above: tuple[Path, ...]) -> tuple[str, int]:
        """Text of a model, and how many elements of `_COUNTED` it has, copies counted."""
        if path.resolve() in above:
            raise InvalidRobot(f"{path}: the model attaches itself")
        self.models += 1
        require_few(self.models, "models, copies counted", MOST_MODELS, str(path))
        root = self._root(path)
        if (
            root.tag != "mujoco"
        ):  # MuJoCo reads URDF too, in any case of letters, and the meshes that it names.
            raise InvalidRobot(f"{path}: the root of a model is {root.tag!r:.100}, expected 'mujoco'")
        self._include(root, path, {path.resolve()})
        sizes = self._attach(root, path, (*above, path.resolve()))
        size = _size(root, sizes)
        out: list[str] = []
        _write(root, None, str(path), out, [1])
        return "".join(out), size

    def _root(self, path: Path) -> Any:
        text = file_bytes(path, self.left)
        self.left -= len(text)
        root = root_element(text, str(path))
        for element in root.iter("*"):
            element.tag = element.tag.rpartition("}")[2]  # MuJoCo knows no namespaces.
        return root

    def _include(self, root: Any, path: Path, seen: set[Path]) -> None:
        """Put the children of every included file in the place of its <include>."""
        for element in list(root.iterfind(".//include")):  # The root itself only holds what is in it.
            name = element.get("file")
            if not name:
                raise InvalidRobot(f"{path}: <include> in line {element.sourceline} has no file")
            file = self._find(name, path)
            if file.resolve() in seen:
                raise InvalidRobot(f"{path}: file {name!r} is included twice")
            seen.add(file.resolve())
            inner = self._root(file)
            self._include(inner, file, seen)
            parent, place = element.getparent(), element.getparent().index(element)
            parent[place : place + 1] = list(inner)

    def _attach(self, root: Any, path: Path, above: tuple[Path, ...]) -> dict[str, int]:
        """Read the models that the file attaches, and return the size of each."""
        sizes = {}
        for element in root.iterfind("asset/model"):
            name = element.get("file")
            if not name:
                raise InvalidRobot(f"{path}: <model> in line {element.sourceline} has no file")
            file = self._find(name, path)
            text, size = self.model(file, above)
            key = f"attached_{len(self.attached)}.xml"
            self.attached[key] = text.encode()
            element.set("file", key)
            if element.get("name") is None:
                element.set("name", file.stem)
            sizes[element.get("name")] = size
        return sizes

    def _find(self, name: str, beside: Path) -> Path:
        """Files are looked for beside the main file first, as MuJoCo does it."""
        try:
            places = [self.folder / name, beside.parent / name]
            return next((place for place in places if place.exists()), places[0])
        except (OSError, ValueError) as error:
            raise InvalidRobot(f"{beside}: no file can be called {name!r}: {error}") from None


def _size(root: Any, attached: dict[str, int]) -> int:
    """Number of elements of `_COUNTED`, with what `replicate` and `attach` make of them."""
    total, stack = sum(attached.values()), [(root, 1)]  # MuJoCo reads those that nothing attaches, too.
    while stack:
        element, times = stack.pop()
        if element.tag == "replicate":
            times *= _count(element.get("count"))
        total += times * (element.tag in _COUNTED)
        if element.tag == "attach":
            total += times * attached.get(element.get("model"), 0)
        stack += [(child, times) for child in _elements(element)]
    return total


def _count(text: str | None) -> int:
    try:
        return max(0, int(float(text or "1")))
    except (ValueError, OverflowError):
        return 1  # MuJoCo will not take it.


def _elements(element: Any) -> Iterator[Any]:
    """Children that are elements: an entity is none."""
    return (child for child in element if isinstance(child.tag, str))


def _write(element: Any, parent: str | None, where: str, out: list[str], line: list[int]) -> None:
    """Write what is kept of an element, in its own line as far as that is possible."""
    if element.tag in _DROPPED.get(parent or "", ()):
        return
    if element.sourceline and element.sourceline > line[0]:
        out.append("\n" * (element.sourceline - line[0]))
        line[0] = element.sourceline
    _check_numbers(element, where)
    out.append(f"<{element.tag}")
    out.extend(f" {name}={quoteattr(value)}" for name, value in element.items() if "{" not in name)
    out.append(">")
    for child in _elements(element):
        _write(child, element.tag, where, out, line)
    out.append(f"</{element.tag}>")


def _check_numbers(element: Any, where: str) -> None:
    for name, value in element.items():
        for word in value.split() if name not in _WORDS else ():
            try:
                number = float(word)
            except ValueError:
                continue  # Not a number: MuJoCo says so.
            # Of what kinematics does not look at, MuJoCo takes infinity; of NaN it warns on the terminal, past Python.
            if math.isnan(number) or (name in _NUMBERS and math.isinf(number)):
                raise InvalidRobot(
                    f"{where}: <{element.tag}> in line {element.sourceline}: {name}={value!r}: {word!r} is not finite"
                )
