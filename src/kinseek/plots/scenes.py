"""Bodies of a scene in space, coloured by what an arm hits, and the way that a motion sweeps."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.collision import Scene
from kinseek.collision.surfaces import Surface, bodies_hit, drawn_bodies, moved, surface_of
from kinseek.errors import InvalidUse
from kinseek.paths.path import Path
from kinseek.robots.chain import SerialChain
from kinseek.timing.trajectory import Trajectory

from .figures import COLOURS

Array = NDArray[np.float64]

MOST_TRIANGLES = 20_000
"""Maximum number of triangles of all meshes of a picture, about one second; further meshes are drawn as boxes."""

BODY, HIT = "0.5", COLOURS[1]
FILL = 0.12
"""Opacity of a surface; two of them cover a body."""

CREASE = 0.9
"""Cosine of the angle between two triangles from which their edge is drawn."""

MOMENTS = 400
"""Number of times at which a trajectory is examined."""

POSTURES = 7
"""Number of postures that are drawn of a motion."""


def rows_of(motion: Path | Trajectory) -> tuple[Array, Array, list[Array]]:
    """Return the joint values of a motion.

    Returns:
        All of them, (N, n), [rad] or [m]; some that are drawn, the last one first, (k, n); and the indices of the rows of
        each part without breaks.
    """
    if isinstance(motion, Path):
        q, breaks = motion.q, motion.breaks
    else:
        q, breaks = motion.q(np.linspace(0.0, motion.duration, MOMENTS)), np.zeros(0, dtype=np.int64)
    shown = np.unique(np.linspace(len(q) - 1, 0, POSTURES).round().astype(int))[::-1]
    return q, q[shown], np.split(np.arange(len(q)), breaks + 1)


def draw_way(axes: Any, chain: SerialChain, motion: Path | Trajectory, scene: Scene | None) -> None:
    """Draw the curve of the tip along a motion, in the colour of what is hit where the arm hits something."""
    q, _, parts = rows_of(motion)
    places = chain.forward(np.ascontiguousarray(q))[:, :3, 3]
    free = np.ones(len(q), dtype=np.bool_) if scene is None else np.asarray(scene.free(q), dtype=np.bool_)
    for part in parts:
        axes.plot(*places[part].T, color="black", linewidth=1.6)
        for run in np.split(part, np.flatnonzero(np.diff(free[part])) + 1):
            if not free[run[0]]:
                axes.plot(*places[run].T, color=HIT, linewidth=2.6)


def draw_scene(axes: Any, chain: SerialChain, scene: Scene, rows: Array, passed: Array) -> None:
    """Draw the bodies of a scene: those that an arm carries at each of its joint values, the others once.

    Args:
        axes: Axes in space.
        chain: The arm.
        scene: Its scene.
        rows: Joint values at which the arm is drawn, (k, n).
        passed: Joint values, (N, n); what is hit at any of them is coloured.
    """
    left, every = MOST_TRIANGLES, bodies_hit(scene, passed)
    at_row = [bodies_hit(scene, row[None]) for row in rows]
    for body in drawn_bodies(scene):
        surface = surface_of(body.parts, left)
        left -= len(surface.faces)
        for row, hit in zip(rows, at_row, strict=True) if body.frame.joints else [(rows[0], every)]:
            if body.name in hit or not body.is_link:  # The arm itself is drawn as a line.
                _draw(axes, surface, body.at(chain, row), body.name in hit)


def require_scene(scene: Any, arm: Any, q: ArrayLike | Path | Trajectory) -> Scene | None:
    """Return the scene of a picture: the given one, or that of a path.

    Raises:
        InvalidScene: It is not a scene of this arm.
        InvalidUse: A motion of another arm.
    """
    if isinstance(q, Path | Trajectory):
        mechanism = q.problem.mechanism if isinstance(q, Path) else q.mechanism
        if mechanism.joint_names != arm.joint_names:
            raise InvalidUse(
                f"the motion must be one of {arm.name!r} with joints {', '.join(arm.joint_names)}, got one of "
                f"{mechanism.name!r} with joints {', '.join(mechanism.joint_names)}"
            )
        if scene is None and isinstance(q, Path):
            scene = q.scene
    if scene is None:
        return None
    from kinseek.collision.solutions import judge_of

    return judge_of(scene, getattr(arm, "mechanism", arm), 0.0, None).scene


def _draw(axes: Any, surface: Surface, pose: Array, hit: bool) -> None:
    from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection

    colour = HIT if hit else BODY
    vertices = moved(surface.vertices, pose)
    if len(surface.faces):
        axes.add_collection3d(
            Poly3DCollection(vertices[surface.faces], facecolor=colour, edgecolor="none", alpha=FILL)
        )
        edges = vertices[_creases(surface)]
        if len(edges):
            axes.add_collection3d(Line3DCollection(edges, colors=colour, linewidths=0.8, alpha=0.7))
        _include(axes, vertices)
    if len(surface.points):
        points = moved(surface.points, pose)
        axes.scatter(*points.T, color=colour, s=1.5, alpha=0.5, linewidths=0.0)


def _creases(surface: Surface) -> NDArray[np.int64]:
    """Return the edges of a surface at which it is bent or ends, as indices of their ends, (e, 2)."""
    faces = surface.faces
    corners = surface.vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, of_edge, count = np.unique(edges, axis=0, return_inverse=True, return_counts=True)
    together = np.zeros((len(unique), 3))
    np.add.at(together, of_edge.ravel(), np.tile(normals, (3, 1)))
    # The sum of two unit vectors is as long as twice the cosine of half the angle between them.
    bent = np.linalg.norm(together, axis=1) < 2.0 * np.sqrt((1.0 + CREASE) / 2.0)
    return np.asarray(unique[bent & (count <= 2)])


def _include(axes: Any, points: Array) -> None:
    axes.auto_scale_xyz(*points.T, had_data=axes.has_data())
