"""An arm with geometry of every kind, written as files: for tests of scenes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import kinseek
from kinseek import Scene

_CYLINDER = '<cylinder radius="{}" length="{}"/>'
_BAR = '<mesh filename="package://thick_meshes/meshes/bar.stl" scale="0.001 0.001 0.001"/>'

_LINKS: dict[str, list[tuple[str, str]]] = {
    "base": [('xyz="0 0 0.05"', _CYLINDER.format(0.1, 0.1))],
    "turret": [('xyz="0 0 0.1"', '<box size="0.12 0.14 0.2"/>')],
    "upper": [('xyz="0 0 0.2"', _BAR)],
    "fore": [
        ('xyz="0 0 0.15" rpy="0.1 0 0"', _CYLINDER.format(0.04, 0.3)),
        ('xyz="0 0.05 0.1"', '<sphere radius="0.03"/>'),
    ],
    "wrist": [("", '<sphere radius="0.05"/>')],
    "hand": [('xyz="0 0 0.09"', '<mesh filename="meshes/wedge.obj"/>')],
    "finger": [('xyz="0 0 0.05"', '<box size="0.02 0.02 0.1"/>')],
    "camera": [("", '<box size="0.04 0.1 0.04"/>')],
    "tip": [],
}

_JOINTS = [
    ("j1", "revolute", "base", "turret", 'xyz="0 0 0.11"', "0 0 1", "-3 3"),
    ("j2", "revolute", "turret", "upper", 'xyz="0 0.08 0.15" rpy="0.2 0 0"', "0 1 0", "-2 2"),
    ("j3", "revolute", "upper", "fore", 'xyz="0 0 0.4"', "0 1 0", "-2.6 2.6"),
    ("j4", "prismatic", "fore", "wrist", 'xyz="0 0 0.35"', "0 0 1", "0 0.1"),
    ("j5", "continuous", "wrist", "hand", 'rpy="0 0.3 0"', "0 1 0", ""),
    ("j6", "revolute", "hand", "tip", 'xyz="0 0 0.2"', "0 0 1", "-3 3"),
    ("grip", "prismatic", "hand", "finger", 'xyz="0 0.03 0.12"', "0 1 0", "0.01 0.05"),
    ("mount", "fixed", "fore", "camera", 'xyz="0.08 0 0.2"', "1 0 0", ""),
]


def _link(name: str) -> str:
    parts = [
        f"<collision><origin {origin}/><geometry>{shape}</geometry></collision>"
        for origin, shape in _LINKS[name]
    ]
    return f'<link name="{name}">{"".join(parts)}</link>'


def _joint(name: str, kind: str, parent: str, child: str, origin: str, axis: str, limits: str) -> str:
    lower, upper = limits.split() or ("0", "0")
    limit = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>' if limits else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin {origin}/><axis xyz="{axis}"/>{limit}</joint>'
    )


ARM = "\n".join(
    ['<robot name="thick">', *map(_link, _LINKS), *(_joint(*joint) for joint in _JOINTS), "</robot>"]
)

TETRAHEDRON = np.array([[0.0, 0.0, 0.06], [0.05, 0.0, -0.04], [-0.03, 0.04, -0.04], [-0.03, -0.04, -0.04]])
FACES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])


def write_stl(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    """Write triangles as text."""
    lines = ["solid one"]
    for face in faces:
        corners = [f"vertex {x!r} {y!r} {z!r}" for x, y, z in vertices[face].tolist()]
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    path.write_text("\n".join([*lines, "endsolid one", ""]))
    return path


def write_obj(path: Path, vertices: np.ndarray, faces: np.ndarray) -> Path:
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in vertices.tolist()]
    path.write_text("\n".join(lines + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces.tolist()]) + "\n")
    return path


def box_mesh(size: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Corners and triangles of a box."""
    corners = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)]) * size
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return corners, np.array([t for a, b, c, d in sides for t in ((a, b, c), (a, c, d))])


def write_arm(folder: Path) -> Path:
    """Write the arm and its meshes; the package lies beside the folder of the arm."""
    package = folder / "packages" / "thick_meshes" / "meshes"
    package.mkdir(parents=True)
    write_stl(package / "bar.stl", *box_mesh((70.0, 50.0, 380.0)))
    (folder / "robot" / "meshes").mkdir(parents=True)
    write_obj(folder / "robot" / "meshes" / "wedge.obj", TETRAHEDRON, FACES)
    path = folder / "robot" / "thick.urdf"
    path.write_text(ARM)
    return path


def scene_of(arm: kinseek.Arm) -> Scene:
    """Return the scene of an arm that was loaded from the file of `write_arm`, with an open gripper."""
    packages = Path(arm.chain.source).parents[1] / "packages"
    return Scene.of(arm, meshes=[packages], joints={"grip": 0.04})
