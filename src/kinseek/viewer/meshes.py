"""Meshes of the links of a URDF. Missing meshes are reported, and no error is raised."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.collision.shapes import MOST_LENGTH
from kinseek.errors import InvalidRobot, KinseekError
from kinseek.kernels.arrays import ChainArrays
from kinseek.meshes.limits import Budget, Size
from kinseek.meshes.parts import import_trimesh
from kinseek.meshes.process import MeshReader
from kinseek.robots.chain import Frame, SerialChain
from kinseek.robots.packages import mesh_path
from kinseek.robots.urdf_file import Robot, numbers_of, origin_of, read_robot

Array = NDArray[np.float64]

MOST_FACES = 1_000_000
"""Maximum number of triangles of all meshes together: more make a browser slow."""

MOST_READ = 2**28
"""Maximum size of the files of all meshes together [bytes]; a file counts as often as it is named."""

MOST_MISSING = 1_000
"""Maximum number of shapes that are searched in vain: each takes milliseconds."""

MOST_REPORTED = 5
"""Maximum number of missing meshes that are named; a missing package causes dozens."""

GREY = (0.72, 0.74, 0.77, 1.0)
"""Default colour."""


@dataclass
class LinkMesh:
    """The visual shape of one link."""

    arrays: ChainArrays
    """The chain up to the frame to which the link is fixed."""
    parts: list[Any] = field(default_factory=list)
    """`trimesh.Trimesh` objects in that frame [m]."""


@dataclass
class Meshes:
    """The visual shapes of an arm's links that were found."""

    links: list[LinkMesh] = field(default_factory=list)
    missing: list[str] = field(default_factory=list)
    """Reasons for shapes that cannot be shown, one sentence each."""

    def report(self) -> list[str]:
        """The first of the missing shapes, and the number of the others."""
        more = len(self.missing) - MOST_REPORTED
        return [*self.missing[:MOST_REPORTED], *([f"… and {more} more"] if more > 0 else [])]


def meshes_of(chain: SerialChain | None, packages: Mapping[str, str | Path] | None = None) -> Meshes:
    """Read the meshes of an arm's own file: of the links between base and tip, and of links fixed to them.

    Args:
        chain: The arm; one that was not read from a URDF, as file, xacro or text, has no meshes.
        packages: Folders of ROS packages by name, for ``package://``, in addition to those that the arm was loaded with.
            Other packages are searched where ROS keeps them, and in the folders above the file.
    """
    found = Meshes()
    if chain is None or not chain.urdf:
        return found
    path, folders = Path(chain.source), {**chain.packages, **(packages or {})}
    robot = read_robot(chain.urdf, chain.source)
    with MeshReader(Budget(MOST_READ)) as reader:
        _add_links(found, robot, chain, _Files(path, folders, reader))
    return found


class _Files(NamedTuple):
    """How the meshes of a file are found and read."""

    path: Path
    packages: Mapping[str, str | Path]
    reader: MeshReader


def _add_links(found: Meshes, robot: Robot, chain: SerialChain, files: _Files) -> None:
    """Add the shapes of all links that can be shown."""
    paints, faces = _paints(robot.root), 0
    for link, frame in _fixed_to(robot, chain):
        mesh = LinkMesh(chain.arrays_to(frame))
        for visual in link.findall("visual"):
            if faces > MOST_FACES:
                found.missing.append(_too_many(link))
                continue
            if len(found.missing) >= MOST_MISSING:
                found.missing.append(
                    f"link {link.get('name')!r}: left out after {MOST_MISSING:,} missing shapes"
                )
                continue
            try:
                parts = list(_shapes(visual, files, paints))
            except (KinseekError, ValueError, TypeError, KeyError, OSError) as error:
                found.missing.append(f"link {link.get('name')!r}: {error}")
                continue
            faces += sum(len(part.faces) for part in parts)
            if faces > MOST_FACES:
                found.missing.append(_too_many(link))
                continue
            mesh.parts += parts
        if mesh.parts:
            found.links.append(mesh)


def _too_many(link: Any) -> str:
    return f"link {link.get('name')!r}: more than {MOST_FACES:,} triangles, left out"


def _fixed_to(robot: Robot, chain: SerialChain) -> Iterator[tuple[Any, Frame]]:
    """Yield the links between base and tip, and those fixed to them, with the frame of the chain that each is in."""
    links = {link.name: link.element for link in robot.links}
    fixed: dict[str, list[tuple[str, Array]]] = {}
    for joint in robot.joints:
        if joint.kind == "fixed":
            fixed.setdefault(joint.parent, []).append((joint.child, origin_of(joint.element)))
    stack = [(name, frame) for name, frame in chain.frames.items() if name in links]
    seen = {name for name, _ in stack}
    while stack:
        name, frame = stack.pop()
        yield links[name], frame
        for child, pose in fixed.get(name, []):
            if child in links and child not in seen:
                seen.add(child)
                stack.append((child, Frame(frame.joints, frame.pose @ pose)))


def _shapes(visual: Any, files: _Files, paints: Mapping[str, tuple[float, ...]]) -> Iterator[Any]:
    """Yield the triangles of one visual in the frame of its link."""
    trimesh = import_trimesh()

    shape = visual.find("geometry")
    shape = None if shape is None else next(iter(shape), None)
    if shape is None:
        raise InvalidRobot("a visual without geometry")
    if shape.tag != "mesh":
        files.reader.budget.take(Size(bodies=1, corners=0))
    if shape.tag == "mesh":
        parts = files.reader.read(mesh_path(shape.get("filename") or "", files.path, files.packages))
        scale = numbers_of(shape.get("scale"), 3, 1.0)
        for part in parts:
            _require_size(float(np.abs(part.vertices).max(initial=0.0)) * float(np.abs(scale).max()))
            part.apply_scale(scale)
            part.merge_vertices()  # They are shaded smoothly. Those nearer than 1e-8 m become one.
    elif shape.tag == "box":
        size = numbers_of(shape.get("size"), 3)
        _require_size(*size)
        parts = [trimesh.creation.box(size)]
    elif shape.tag == "cylinder":
        radius, length = (float(numbers_of(shape.get(name), 1)[0]) for name in ("radius", "length"))
        _require_size(radius, length)
        parts = [trimesh.creation.cylinder(radius, length, sections=32)]
    elif shape.tag == "sphere":
        radius = float(numbers_of(shape.get("radius"), 1)[0])
        _require_size(radius)
        parts = [trimesh.creation.icosphere(3, radius)]
    else:
        raise InvalidRobot(f"geometry {shape.tag!r} cannot be shown")
    paint = _paint_of(visual.find("material"), paints)
    for part in parts:
        if paint is not None or shape.tag != "mesh" or not part.visual.defined:
            part.visual = _look(paint or GREY)
        part.apply_transform(origin_of(visual))
        yield part


def _require_size(*lengths: float) -> None:
    """Make sure that a shape is not so large that computing with it overflows.

    Raises:
        InvalidRobot: It is larger than a shape of a scene may be.
    """
    if not all(length <= MOST_LENGTH for length in lengths):
        raise InvalidRobot(f"a shape of {max(lengths):.3g} m cannot be shown, at most {MOST_LENGTH:g} m")


def plain(mesh: Any) -> Any:
    """Return the shape of a mesh, a `trimesh.Trimesh`, in the default colour."""
    import trimesh

    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=False, visual=_look(GREY))


def _look(colour: tuple[float, ...]) -> Any:
    import trimesh

    return trimesh.visual.TextureVisuals(
        material=trimesh.visual.material.PBRMaterial(
            baseColorFactor=colour, metallicFactor=0.1, roughnessFactor=0.7
        )
    )


def _paints(robot: Any) -> dict[str, tuple[float, ...]]:
    """Return the colours that a robot's file defines for all links."""
    named = {}
    for material in robot.findall("material"):
        colour = material.find("color")
        if colour is not None and material.get("name"):
            named[material.get("name")] = _rgba(colour)
    return named


def _paint_of(material: Any, paints: Mapping[str, tuple[float, ...]]) -> tuple[float, ...] | None:
    """Return the colour of a visual, if its file gives one."""
    if material is None:
        return None
    colour = material.find("color")
    return paints.get(material.get("name") or "") if colour is None else _rgba(colour)


def _rgba(colour: Any) -> tuple[float, ...]:
    return tuple(np.clip(numbers_of(colour.get("rgba"), 4), 0.0, 1.0).tolist())
