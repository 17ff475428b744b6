"""Obstacles from files: a URDF whose joints are fixed, or a planning scene in MoveIt's text format."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidGoal, InvalidRobot, InvalidScene
from kinseek.pose_arguments import pose
from kinseek.robots.chain import Frame
from kinseek.robots.files import MOST_NAME, file_bytes
from kinseek.robots.urdf import fixed_links
from kinseek.robots.urdf_file import read_robot
from kinseek.robots.xacro import urdf_text

from .bodies import MOST_HULL_CORNERS, Body, MeshFiles, Part, parts_of, require_number, require_small
from .interior import MOST_COMPARED
from .shapes import Box, Cylinder, Mesh, Shape, Sphere

Array = NDArray[np.float64]

URDF, XACRO, MOVEIT = ".urdf", ".xacro", ".scene"

MOST_OBJECTS = 10_000
"""Of a MoveIt scene, and as many subframes: each takes some 40 µs, whether it has shapes or not."""

DIGITS = 9
"""Maximum number of digits of an integer in a file; a larger number is invalid."""


def obstacles(
    path: Path, folders: Mapping[str, Path], skip: bool, trusted: bool
) -> tuple[list[Body], list[str]]:
    """Read a file of obstacles.

    Args:
        path: A .urdf, .xacro or .scene file.
        folders: Folders of packages by name.
        skip: Leave unreadable meshes out?
        trusted: May Python evaluate the expressions of a xacro file?

    Returns:
        Bodies with their poses in the root of the file, and notes on omitted meshes.

    Raises:
        InvalidScene: The file cannot be read, has movable joints, or has no shapes.
    """
    try:
        if path.suffix.lower() == MOVEIT:
            found, notes = _moveit(file_bytes(path), str(path)), list[str]()
        elif path.suffix.lower() in (URDF, XACRO):
            found, notes = _urdf(urdf_text(path, None, folders, trusted), path, folders, skip)
        else:
            raise InvalidScene(
                f"{str(path)!r} is not a file of obstacles; expected {URDF}, {XACRO}, or {MOVEIT} as MoveIt writes "
                "it. Add a mesh with add_mesh, or refer to it in a URDF"
            )
    except (InvalidRobot, InvalidScene) as error:
        where = "" if str(path) in str(error) else f"{path}: "
        raise InvalidScene(f"{where}{error}") from error
    if not found:
        what = "no objects" if path.suffix.lower() == MOVEIT else "no collision elements"
        raise InvalidScene(f"{path}: no obstacles: {'; '.join(notes) or f'it has {what}'}")
    _box_most(found)
    _require_few_surfaces(found, path)
    return found, notes


def _box_most(bodies: list[Body]) -> None:
    """Box the meshes whose hulls would take long: those after the first with `MOST_HULL_CORNERS` corners together."""
    known, spent = dict[Mesh, Mesh](), 0
    for body in bodies:
        for number, (shape, place) in enumerate(body.parts):
            if not isinstance(shape, Mesh):
                continue
            if shape not in known:
                known[shape] = replace(shape, boxed=True) if spent > MOST_HULL_CORNERS else shape
                spent += known[shape].cost
            body.parts[number] = Part(known[shape], place)


def _require_few_surfaces(bodies: list[Body], path: Path) -> None:
    """Make sure that finding the cavities of all meshes together takes little longer than that of one mesh may.

    Raises:
        InvalidScene: It takes longer.
    """
    meshes, compared = set[Mesh](), 0
    for body in bodies:
        for shape in [part.shape for part in body.parts if isinstance(part.shape, Mesh)]:
            compared += 0 if shape in meshes else shape.interior.compared
            meshes.add(shape)
            if compared > 2 * MOST_COMPARED:
                raise InvalidScene(
                    f"{path}: the meshes up to {body.name!r} have too many surfaces that may lie in each other or share "
                    "edges; simplify the meshes, or use their convex hulls"
                )


def _urdf(text: bytes, path: Path, folders: Mapping[str, Path], skip: bool) -> tuple[list[Body], list[str]]:
    robot, bodies, notes = read_robot(text, str(path)), list[Body](), list[str]()
    poses = fixed_links(robot)
    with MeshFiles(path, folders, hull=False) as meshes:
        for link in robot.links:
            parts = parts_of(link.element, meshes, skip, notes)
            if parts:
                bodies.append(Body(link.name, Frame(0, poses[link.name]), parts))
    return bodies, notes


class _Words:
    """Tokenizer of a MoveIt scene: a word is what stands between spaces, or the whole name of an object."""

    def __init__(self, text: str, where: str) -> None:
        self._where = where
        lines = text.split("\n")  # As MoveIt: other line ends are part of a name.
        starts = [
            n for n, line in enumerate(lines) if n and line.startswith("*")
        ]  # Line 0 is the scene's name.
        # A file with poses of objects, besides those of shapes, has a pose in the line below the first name; otherwise that
        # line has a number of shapes (moveit_core, PlanningScene::loadGeometryFromStream).
        below = lines[starts[0] + 1] if starts and starts[0] + 1 < len(lines) else ""
        self.has_poses = len(below.split()) > 1
        self._sizes = {"vertices": 0, "triangles": 0}
        """Numbers in all meshes up to here."""
        self._line = 1
        """Number of the line of the word that was taken last."""
        self._left = self._split(lines[1:])

    def _split(self, lines: list[str]) -> Iterator[str]:
        for self._line, line in enumerate(lines, start=2):  # The first line is the scene's name.
            if line.startswith("*"):
                yield "*"
                yield line[1:].strip()
            else:
                yield from line.split()

    def take(self, what: str) -> str:
        """Take the next word."""
        word = next(self._left, None)
        if word is None:
            raise InvalidScene(f"{self._where}: the file ends where {what} was expected")
        return word

    def wrong(self, word: str, expected: str) -> InvalidScene:
        """Make the error for the word that was taken last, which is not the expected one."""
        return InvalidScene(f"{self._where}: line {self._line}: expected {expected}, got {word!r}")

    def numbers(self, count: int, what: str) -> list[float]:
        """Read `count` finite numbers."""
        found = []
        for _ in range(count):
            word = self.take(what)
            try:
                # Python takes 1_0 for 10, and MoveIt for 1; Python also reads digits of other scripts.
                found.append(float(word if word.isascii() and "_" not in word else "x"))
            except ValueError:
                raise self.wrong(word, f"a number of {what}") from None
            if not isfinite(found[-1]):
                raise self.wrong(word, f"a finite number of {what}")
        return found

    def count(self, what: str) -> int:
        """Read an integer of at least 0."""
        word = self.take(what)
        if not (word.isascii() and word.isdigit() and len(word) <= DIGITS):
            raise self.wrong(word, f"the {what}")
        return int(word)

    def size(self, noun: str, what: str) -> int:
        """Read the number of vertices or triangles of a mesh.

        Raises:
            InvalidScene: The meshes up to here have too many together.
        """
        count = self.count(f"number of {noun} of {what}")
        self._sizes[noun] += count
        require_small(self._sizes[noun], noun, f"{self._where}: the meshes up to that of {what}")
        return count

    def pose(self, what: str) -> Array:
        """Read a position and a quaternion, real part last, (4, 4)."""
        place, turn = self.numbers(3, f"the position of {what}"), self.numbers(4, f"the rotation of {what}")
        try:
            return np.asarray(pose(place, quat_xyzw=turn))
        except InvalidGoal as error:
            raise InvalidScene(f"{self._where}: the pose of {what}: {error}") from None


def _moveit(content: bytes, where: str) -> list[Body]:
    try:
        words = _Words(content.decode("utf-8"), where)
    except UnicodeDecodeError:
        raise InvalidScene(f"{where} is not text") from None
    bodies: dict[str, Body] = {}
    objects = shapes = subframes = 0
    while (word := words.take("* or a point at the end")) != ".":
        if word != "*":
            raise words.wrong(word, "* and a name, or a point at the end")
        name = words.take("a name")
        if not name or name in bodies:
            raise words.wrong(name, "a name that no other object has")
        if len(name) > MOST_NAME:
            raise InvalidScene(f"{where}: {len(name):,} letters in a name, expected at most {MOST_NAME:,}")
        if (objects := objects + 1) > MOST_OBJECTS:
            raise InvalidScene(f"{where}: {objects:,} objects, expected at most {MOST_OBJECTS:,}")
        what = repr(name)
        place = words.pose(what) if words.has_poses else np.eye(4)
        body = Body(name, Frame(0, place))
        shapes += (count := words.count(f"number of shapes of {what}"))
        require_number(shapes)
        for _ in range(count):
            shape = _shape(words, what)
            body.parts.append(Part(shape, words.pose(f"a shape of {what}")))
            words.numbers(4, f"the colour of {what}")
        if words.has_poses:
            subframes += (count := words.count(f"number of subframes of {what}"))
            if subframes > MOST_OBJECTS:
                raise InvalidScene(f"{where}: {subframes:,} subframes, expected at most {MOST_OBJECTS:,}")
            for _ in range(count):
                words.take("the name of a subframe")
                words.numbers(7, f"the pose of a subframe of {what}")
        if body.parts:
            bodies[name] = body
    return list(bodies.values())


def _shape(words: _Words, what: str) -> Shape:
    try:
        return _read_shape(words, what)
    except InvalidScene as error:
        raise InvalidScene(str(error) if what in str(error) else f"{what}: {error}") from None


def _read_shape(words: _Words, what: str) -> Shape:
    kind = words.take(f"a shape of {what}")
    lengths = f"the size of {what}"
    if kind == "box":
        return Box(words.numbers(3, lengths))
    if kind == "sphere":
        return Sphere(words.numbers(1, lengths)[0])
    if kind == "cylinder":
        radius, length = words.numbers(2, lengths)
        return Cylinder(radius, length)
    if kind == "mesh":
        vertices, faces = words.size("vertices", what), words.size("triangles", what)
        points = np.array(words.numbers(3 * vertices, f"a vertex of {what}")).reshape(-1, 3)
        corners = [words.count(f"corner of a triangle of {what}") for _ in range(3 * faces)]
        return Mesh(points, np.array(corners, dtype=np.int64).reshape(-1, 3), hull=False, name=what)
    raise words.wrong(kind, f"box, sphere, cylinder or mesh as a shape of {what}")
