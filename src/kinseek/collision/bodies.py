"""Bodies of an arm: the links of its file with their collision elements, or capsules if it has none."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem, InvalidRobot, InvalidScene
from kinseek.robots import read
from kinseek.robots.adapters import is_text
from kinseek.robots.chain import Frame, SerialChain
from kinseek.robots.files import file_bytes, home_path, without_links
from kinseek.robots.mechanism import no_axes
from kinseek.robots.packages import mesh_path
from kinseek.robots.urdf_file import numbers_of, origin_of
from kinseek.robots.xacro import urdf_text
from kinseek.robots.xml_files import root_element
from kinseek.support.transforms import transform

from .links import link_frames, neighbours_of, same_robot
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, length, reader_of_shapes

Array = NDArray[np.float64]

SHORT = 1e-6
"""A link shorter than this gets no capsule [m]."""

MOST_SHAPES = 2_000
"""Of all bodies of a scene together. Every two bodies are a pair, also two that never move against each other, and the time
in which pinocchio takes shapes grows with the cube of their number."""

MOST_TRIANGLES = 2**21
"""Of the meshes of one file of obstacles together, and as many vertices of a ``.scene`` file: coal's tree takes some 600
bytes and 8 µs for each triangle."""

MOST_HULL_CORNERS = 50_000
"""Of the meshes of one file together, without the last one. For these the first check of a scene takes some seconds. Further
meshes are refused if they are used as hulls, and boxed if not."""


class Part(NamedTuple):
    """One shape of a body."""

    shape: Shape
    pose: Array
    """Pose in the frame of the body, (4, 4), lengths in [m]."""


@dataclass
class Body:
    """A named body: a link, an obstacle, or an object attached to a link."""

    name: str
    frame: Frame
    """Joint of the arm that carries it, and its pose in that joint's frame. Without a joint it is fixed in the base."""
    parts: list[Part] = field(default_factory=list)
    is_link: bool = False
    is_attached: bool = False
    """Is it attached to a link, which need not be one that a joint moves?"""
    padding: float = 0.0
    """Added to it on every side [m]."""

    @property
    def of_arm(self) -> bool:
        """Is it a link, or attached to one?"""
        return self.is_link or self.is_attached


@dataclass
class ArmBodies:
    """The bodies of an arm, with notes from reading them."""

    bodies: list[Body]
    neighbours: list[tuple[str, str]]
    """Pairs of links that a joint connects."""
    notes: list[str]
    """Notes for the user: what was left out, and what was replaced."""
    links: dict[str, Frame]
    """All links, including those without geometry."""
    robot: str = ""
    """Name of the robot in the file."""


def chain_of(arm: Any, trusted: bool) -> SerialChain:
    """Return the axes and links of an arm, or of anything that `kinseek.load` takes.

    Args:
        arm: The arm.
        trusted: May Python evaluate the expressions of a xacro file?

    Raises:
        InvalidProblem: The arm has black-box kinematics.
    """
    mechanism = getattr(arm, "mechanism", arm)
    if hasattr(mechanism, "joint_names") and hasattr(mechanism, "axes"):
        if mechanism.axes is None:
            raise InvalidProblem(no_axes(mechanism, "a scene needs the links of an arm"))
        chain: SerialChain = mechanism.axes
        return chain
    return read(arm, trusted=trusted)


def arm_bodies(
    chain: SerialChain,
    folders: Mapping[str, Path],
    capsules: float | None,
    urdf: str | Path | None,
    joints: Mapping[str, float],
    skip: bool,
    trusted: bool = True,
) -> ArmBodies:
    """Return the bodies of an arm: those of its file, or capsules if it has none; see `Scene.of`.

    Raises:
        InvalidScene: Neither geometry nor `capsules`, or both, or an error of `read_bodies`.
    """
    file = described(chain, urdf, trusted)
    known = {name: without_links(home_path(folder)) for name, folder in chain.packages.items()}
    found = None if file is None else read_bodies(chain, *file, {**known, **folders}, skip, joints)
    if found is not None and found.bodies:
        if capsules is not None:
            raise InvalidScene("capsules replace links without a shape, and the file of this arm has shapes")
        return found
    if capsules is not None:
        return capsules_along(chain, length("capsules", capsules))
    what = (
        f"{str(file[1])!r} has no collision elements"
        if file is not None
        else f"{chain.source or 'it'!r} is no URDF file"
    )
    raise InvalidScene(
        f"the shape of arm {chain.name!r} is not known: {what}. Give the file that contains it, urdf=..., or the radius of "
        f"capsules that replace the links, capsules=0.05"
    )


def described(
    chain: SerialChain, urdf: str | Path | bytes | None, trusted: bool
) -> tuple[bytes, Path] | None:
    """Return the text of an arm's URDF, and the path to which its references are relative; None if there is no URDF.

    Raises:
        InvalidRobot: The file cannot be read.
    """
    if urdf is None:  # The text that the arm was loaded from; of a xacro file, after expansion.
        return (chain.urdf, home_path(chain.source)) if chain.urdf else None
    if is_text(urdf):
        return (urdf.encode() if isinstance(urdf, str) else bytes(urdf)), Path("the URDF text")
    path = home_path(str(urdf))
    if path.suffix.lower() not in (".urdf", ".xacro", ".xml") or not os.path.isfile(path):
        file_bytes(path)  # Raises an error that describes the problem.
        raise InvalidScene(f"urdf must be a .urdf or .xacro file, or the text of one, got {str(urdf)!r}")
    return urdf_text(path, None, chain.packages, trusted), path


def read_bodies(
    chain: SerialChain,
    text: bytes,
    path: Path,
    folders: Mapping[str, Path],
    skip: bool,
    joints: Mapping[str, float],
) -> ArmBodies:
    """Read the collision elements of all links of a URDF.

    Args:
        chain: The arm.
        text: The URDF.
        path: Its path.
        folders: Folders of packages by name.
        skip: Leave unreadable meshes out, with a note?
        joints: Values of joints that do not belong to the arm, [rad] or [m].

    Raises:
        InvalidScene: A mesh or another element that cannot be used, or links or joints that do not fit.
    """
    robot = same_robot(chain, root_element(text, str(path)), path)
    notes: list[str] = []
    frames = link_frames(robot, chain, joints, notes)
    bodies = []
    with MeshFiles(path, folders) as meshes:
        for link in robot.links:
            if link.name not in frames:
                continue
            parts = parts_of(link.element, meshes, skip, notes)
            if parts:
                bodies.append(Body(link.name, frames[link.name], parts, is_link=True))
    solid = {body.name for body in bodies}
    return ArmBodies(bodies, neighbours_of(robot, solid), notes, frames, robot.name)


def require_number(shapes: int) -> None:
    """Make sure that a scene takes so many shapes.

    Raises:
        InvalidScene: There are too many.
    """
    if shapes > MOST_SHAPES:
        raise InvalidScene(
            f"{shapes:,} shapes of bodies, expected at most {MOST_SHAPES:,}: combine fixed shapes into one mesh, or "
            "points into one cloud"
        )


def require_small(count: int, noun: str, meshes: str) -> None:
    """Make sure that the meshes of a file of obstacles are not too large together.

    Raises:
        InvalidScene: They have more than `MOST_TRIANGLES` triangles or vertices.
    """
    if count > MOST_TRIANGLES:
        raise InvalidScene(
            f"{meshes} have {count:,} {noun} together, expected at most {MOST_TRIANGLES:,} in one file: simplify the meshes"
        )


class MeshFiles:
    """The meshes referenced by one file. A repeated reference gives the same object, and all share one reader."""

    def __init__(self, path: Path, folders: Mapping[str, Path], hull: bool = True) -> None:
        """Read meshes for the file at `path`, with packages by name, and with or without taking their convex hulls."""
        self.path = path
        self._folders, self._hull, self._reader = folders, hull, reader_of_shapes()
        self._known: dict[tuple[str, tuple[float, ...]], Mesh] = {}
        self._corners = self._triangles = self.shapes = 0

    def __enter__(self) -> MeshFiles:
        """End the reader at the end of the block."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End the reader."""
        self._reader.close()

    def read(self, name: str, scale: Array) -> Mesh:
        """Read one mesh, with a factor along each axis, (3,).

        Raises:
            InvalidRobot: It is nowhere.
            InvalidScene: It cannot be read, or has no hull; or the budget is spent, or hulls have too many corners together.
        """
        key = name, tuple(scale.tolist())
        if key not in self._known:
            if self._corners > MOST_HULL_CORNERS:
                raise InvalidScene(
                    f"{name!r}: the convex hulls of the meshes before it have {self._corners:,} corners together, expected "
                    f"at most {MOST_HULL_CORNERS:,} in one file: simplify the meshes, so that they have fewer vertices "
                    "where they are curved"
                )
            found = mesh_path(name, self.path, self._folders, "meshes=")
            mesh = Mesh.read(found, scale, self._hull, reader=self._reader)
            self._triangles += 0 if self._hull else len(mesh.faces)
            require_small(
                self._triangles, "triangles", f"{name!r}: the meshes up to this one, each scale counted,"
            )
            mesh.geometry()  # Says now that there is no hull.
            self._corners += mesh.cost if self._hull else 0
            self._known[key] = mesh
        return self._known[key]


def parts_of(link: Any, meshes: MeshFiles, skip: bool, notes: list[str]) -> list[Part]:
    """Return the collision elements of a link.

    Args:
        link: Link of the file.
        meshes: The meshes referenced by the file.
        skip: Leave unreadable meshes out, with a note?
        notes: Notes on omitted meshes are appended here.

    Raises:
        InvalidScene: A mesh or another element that cannot be used.
    """
    parts = []
    for number, element in enumerate(link.findall("collision"), start=1):
        meshes.shapes += 1  # Also those that are left out: each takes the time of a search, and a note.
        require_number(meshes.shapes)
        try:
            parts.append(Part(_shape(element, meshes), origin_of(element)))
        except (InvalidRobot, InvalidScene) as error:
            message = f"link {link.get('name')!r}, collision element {number}: {error}"
            if not isinstance(error, _Unreadable):
                raise InvalidScene(f"{meshes.path}: {message}") from error
            if not skip:
                raise InvalidScene(f'{meshes.path}: {message} (missing="skip" skips such meshes)') from error
            notes.append(f"left out: {message}")
    return parts


def capsules_along(chain: SerialChain, radius: float) -> ArmBodies:
    """Return capsules from joint to joint, as a substitute for missing geometry."""
    bodies: list[Body] = []
    names = {frame.joints: name for name, frame in reversed(list(chain.frames.items()))}
    for k in range(len(chain.leader) + 1):
        end = chain.fixed[k, :, 3]
        if chain.tooled and k == len(chain.leader):
            # The link ends where the tool begins; the shape of the tool is unknown.
            end = chain.frames[chain.tip].pose[:3, 3]
        if (span := float(np.linalg.norm(end))) < SHORT:
            continue
        part = Part(Capsule(radius, span), transform(_z_along(end / span), end / 2))
        bodies.append(Body(names[k], Frame(k, np.eye(4)), [part], is_link=True))
    neighbours = [(a.name, b.name) for a, b in pairwise(bodies)]
    missing = "; what slides has no capsule along the slide" if chain.prismatic.any() else ""
    missing += (
        "" if bodies else "; no link has a length, so only bodies that are added or attached are checked"
    )
    note = (
        f"capsules of radius {radius:g} m along the links replace shapes that the file does not have: where they are free, "
        f"the real arm may touch, and where they touch, it may be free{missing}"
    )
    # An arm lists the names of its links from base to tip, and then those of its joints.
    last = list(chain.frames).index(chain.tip)
    return ArmBodies(bodies, neighbours, [note], dict(list(chain.frames.items())[: last + 1]), chain.name)


def package_folders(meshes: Iterable[str | Path] | Mapping[str, str | Path]) -> dict[str, Path]:
    """Return folders of packages by name, from such a mapping, or from folders that are packages or contain packages.

    Raises:
        InvalidScene: Not folders.
    """
    is_one = (
        isinstance(meshes, np.ndarray) and not meshes.ndim
    )  # An array without dimensions cannot be iterated.
    if is_one or not isinstance(meshes, Iterable):
        raise InvalidScene(
            f"meshes must be folders, or a mapping from packages to folders, got {meshes!r:.80}"
        )
    named = dict(meshes) if isinstance(meshes, Mapping) else {}
    listed = (
        [] if isinstance(meshes, Mapping) else [meshes] if isinstance(meshes, str | Path) else list(meshes)
    )
    for folder in [*named.values(), *listed]:
        if not isinstance(folder, str | Path) or not os.path.isdir(home_path(folder)):
            raise InvalidScene(f"meshes: no folder {str(folder)!r}")
    found: dict[str, Path] = {}
    for folder in listed:
        path = without_links(home_path(folder))
        found.setdefault(path.name, path)
        try:
            inner = sorted(each for each in path.iterdir() if each.is_dir())
        except OSError as error:
            raise InvalidScene(f"meshes: cannot read the folder {str(folder)!r}: {error.strerror}") from None
        for each in inner:
            found.setdefault(each.name, each)
    return found | {name: without_links(home_path(folder)) for name, folder in named.items()}


class _Unreadable(InvalidScene):
    """A mesh that may be left out; other errors in a file must be fixed."""


def _shape(element: Any, meshes: MeshFiles) -> Shape:
    geometry = element.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if shape is None:
        raise InvalidScene("no geometry")
    if shape.tag == "box":
        return Box(numbers_of(shape.get("size"), 3))
    if shape.tag == "sphere":
        return Sphere(float(numbers_of(shape.get("radius"), 1)[0]))
    if shape.tag in ("cylinder", "capsule"):
        radius, span = (float(numbers_of(shape.get(name), 1)[0]) for name in ("radius", "length"))
        return Cylinder(radius, span) if shape.tag == "cylinder" else Capsule(radius, span)
    if shape.tag == "mesh":
        name = shape.get("filename") or ""
        scale = numbers_of(shape.get("scale"), 3, 1.0)
        try:
            return meshes.read(name, scale)
        except (InvalidRobot, InvalidScene) as error:
            raise _Unreadable(str(error)) from error
    raise InvalidScene(
        f"geometry {shape.tag!r} is not known; expected box, sphere, cylinder, capsule or mesh"
    )


def _z_along(way: Array) -> Array:
    """Return a rotation that maps z to a unit vector, (3, 3)."""
    helper = np.eye(3)[np.argmin(np.abs(way))]
    x = np.cross(helper, way)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(way, x), way])
