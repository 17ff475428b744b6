"""Meshes that are too large are said to be so, and what simplifying takes off is given back; xacro files with arguments."""

from __future__ import annotations

import itertools
import pickle
import re
import subprocess
import sys
import time
import tracemalloc
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

import kinseek
from cells import write_arm, write_obj, write_stl
from kinseek import InvalidScene, Scene
from kinseek.collision import Mesh, Points, bodies, closed_surfaces, interior, obstacles, shapes
from kinseek.collision.geometry import triangles
from kinseek.collision.hulls import MOST_CORNERS, directions, farthest_beyond, outermost
from kinseek.collision.interior import Interior
from kinseek.collision.simplify import simplified
from kinseek.meshes.parts import mesh_parts

pytest.importorskip("pinocchio")
trimesh = pytest.importorskip("trimesh")


def ball(
    radius: float, level: int = 3, place: tuple[float, float, float] = (0, 0, 0)
) -> tuple[np.ndarray, np.ndarray]:
    made = trimesh.creation.icosphere(level, radius=radius)
    return np.array(made.vertices) + place, np.array(made.faces)


def together(*parts: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    starts = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    return np.concatenate([v for v, _ in parts]), np.concatenate(
        [f + s for (_, f), s in zip(parts, starts, strict=False)]
    )


def away(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Distance of each point, (k, 3), from the nearest triangle."""
    corners = vertices[faces]
    return np.array(
        [
            np.linalg.norm(
                trimesh.triangles.closest_point(corners, np.repeat(p[None], len(faces), 0)) - p, axis=1
            ).min()
            for p in points
        ]
    )


THIN = trimesh.creation.torus(0.1, 0.003)
SPECKS = together(ball(0.1), *(ball(0.001, 1, (0.15 + 0.05 * i, 0.0, 0.0)) for i in range(3)))


@pytest.mark.slow
@pytest.mark.parametrize(
    "mesh",
    [ball(0.1), (np.array(THIN.vertices), np.array(THIN.faces)), SPECKS],
    ids=["ball", "ring", "specks"],
)
@pytest.mark.parametrize("tolerance", [0.004, 0.03])
def test_what_is_simplified_and_made_thicker_holds_the_mesh(
    mesh: tuple[np.ndarray, np.ndarray], tolerance: float
) -> None:
    vertices, faces, moved, _ = simplified(*mesh, tolerance)
    assert moved <= tolerance
    whole = trimesh.Trimesh(*mesh, process=False)
    points = trimesh.sample.sample_surface(whole, 120, seed=1)[0]
    assert away(points, vertices, faces).max() <= moved
    before, after = Mesh(*mesh, hull=False), Mesh(vertices, faces, hull=False)
    assert before.closed
    assert (
        after.closed or not after.interior.any_solid
    )  # Of the ring two sides are left that enclose nothing.
    off = points + np.random.default_rng(0).normal(size=points.shape) * 0.02
    inside = np.array([before.holds(p) for p in off])
    assert inside.any()
    kept = np.array([after.holds(p) for p in off])
    assert (kept | (away(off, vertices, faces) <= moved))[inside].all()
    assert not (kept & (away(off, *mesh[:2]) > moved))[~inside].any()  # And nothing far outside has come in.


def cube(size: float, x: float = 0.0, inverted: bool = False) -> tuple[np.ndarray, np.ndarray]:
    made = trimesh.creation.box((size,) * 3)
    faces = np.array(made.faces)
    return np.array(made.vertices) + np.array([x, 0, 0]), faces[:, ::-1] if inverted else faces


def turned_over(mesh: tuple[np.ndarray, np.ndarray], *which: int) -> tuple[np.ndarray, np.ndarray]:
    faces = mesh[1].copy()
    faces[[*which]] = faces[[*which], ::-1]
    return mesh[0], faces


def klein() -> tuple[np.ndarray, np.ndarray]:
    """A closed surface without an inside: a tube whose ends are joined with opposite orientations."""
    count = 12
    quads = []
    for i in range(count):
        for j in range(count):
            ahead, left, right = (i + 1) % count, j, (j + 1) % count
            far = [(-k) % count if i == count - 1 else k for k in (left, right)]
            quads.append(
                [count * i + left, count * ahead + far[0], count * ahead + far[1], count * i + right]
            )
    sides = np.array(quads)
    vertices = np.random.default_rng(0).normal(size=(count * count, 3))
    return vertices, np.concatenate([sides[:, [0, 1, 2]], sides[:, [0, 2, 3]]])


CENTRE, WALL, CORE, SIDE = (np.array([x, 0.013, 0.007]) for x in (0.0, 1.8, 0.6, 2.2))
ROOM = together(cube(4), cube(3, inverted=True))
SURFACES: dict[str, tuple[tuple[np.ndarray, np.ndarray], bool, tuple[bool, bool, bool, bool]]] = {
    "box": (cube(4), True, (True, True, True, False)),
    "inside out": (cube(4, inverted=True), True, (True, True, True, False)),
    **{
        f"{count} turned over": (turned_over(cube(4), *range(count)), True, (True, True, True, False))
        for count in (1, 3, 4, 6)
    },
    "overlapping": (together(cube(4, -0.1), cube(4, 0.1, True)), True, (True, True, True, False)),
    "twice": (together(cube(4), cube(4)), True, (True, True, True, False)),
    "room": (ROOM, True, (False, True, False, False)),
    "room, inside out": (turned_over(ROOM, *range(24)), True, (False, True, False, False)),
    "room with a box in it": (together(ROOM, cube(1, 0.6)), True, (False, True, True, False)),
    "room with a box inside out": (together(ROOM, cube(1, 0.6, True)), True, (False, True, True, False)),
    "room of two boxes": (together(cube(4), cube(3)), True, (True, True, True, False)),
    "room with a triangle turned over": (turned_over(ROOM, 3), True, (True, True, True, False)),
    "room with a triangle turned over inside": (turned_over(ROOM, 20), True, (True, True, True, False)),
    "box beside a sheet": (
        together(cube(4), (cube(1, 9)[0], cube(1)[1][:2])),
        False,
        (True, True, True, False),
    ),
    "lid off": ((cube(4)[0], cube(4)[1][:10]), False, (False, False, False, False)),
    "both sides": (together(cube(4), cube(4, inverted=True)), True, (True, True, True, False)),
    "both sides in turn": (
        (cube(4)[0], np.stack([cube(4)[1], cube(4, inverted=True)[1]], axis=1).reshape(-1, 3)),
        True,
        (True, True, True, False),
    ),
    "lid off, both sides": (
        (cube(4)[0], np.concatenate([cube(4)[1][:10], cube(4, inverted=True)[1][:10]])),
        False,
        (False, False, False, False),
    ),
}


@pytest.mark.parametrize("name", SURFACES)
def test_every_closed_surface_is_solid_however_it_is_oriented(name: str) -> None:
    """Triangles that were turned over, and boxes inside out, took away from the inside of the others."""
    (vertices, faces), closed, expected = SURFACES[name]
    corners = vertices[faces].reshape(-1, 3)  # As in an STL file.
    for mesh in (Mesh(vertices, faces, False), Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)):
        assert mesh.closed == closed
        assert tuple(mesh.holds(point) for point in (CENTRE, WALL, CORE, SIDE)) == expected
        again = Mesh(mesh.vertices, mesh.interior.faces, False)
        assert np.array_equal(again.interior.faces, mesh.interior.faces)


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("place", [[4, 4, 0], [4, 0, 0]])
def test_boxes_that_share_an_edge_or_a_side_are_both_solid(place: list[int], mirrored: bool) -> None:
    """The volumes of two halves of which one is mirrored cancel; the scene was free inside of both."""
    vertices, faces = cube(4)
    other = vertices * [-1, 1, 1] if mirrored else vertices
    mesh = Mesh(*together((vertices, faces), (other + place, faces)), False)
    assert mesh.holds(CENTRE)
    assert mesh.holds(np.array(place) + 0.01)
    assert not mesh.holds(np.array([0.01, 3.02, 0.03]))
    assert mesh.closed


@pytest.mark.parametrize("inverted", [False, True])
@pytest.mark.parametrize("sides", [(0.8, 1, 1), (0.8, 0.6, 1), (0.8, 0.6, 0.9)])
@pytest.mark.parametrize("again", [False, True], ids=["once", "with a third"])
def test_a_box_in_a_corner_of_another_takes_nothing_away_from_it(
    sides: tuple[float, float, float], inverted: bool, again: bool
) -> None:
    """Of an inner box inside out, the triangles that both share cancelled: the scene was free inside of it."""
    vertices, faces = cube(4)
    inner = (vertices + 2) * sides - 2, faces[:, ::-1] if inverted else faces
    third = [(inner[0] * 0.5 - 1, faces)] if again else []
    mesh = Mesh(*together((vertices, faces), inner, *third), False)
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    for each in (mesh, Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)):
        assert each.closed
        assert each.holds(CENTRE)
        assert each.holds(np.full(3, -1.9))
        assert each.holds(np.full(3, 1.9))
        assert not each.holds(SIDE)


def test_a_surface_in_both_orientations_elsewhere_changes_no_inside() -> None:
    """With one far away, a box inside out took its part away from the one that it shares triangles with."""
    vertices, faces = cube(4)
    double, sheet = cube(1, 30.0), cube(1, 30.0)[1][:10]
    decoy = double[0], np.concatenate([sheet, sheet[:, ::-1]])
    for sides in ((0.8, 1, 1), (0.8, 0.6, 1), (1, 1, 0.5)):
        inner = (vertices + 2) * sides - 2, faces[:, ::-1]
        plain = Mesh(*together((vertices, faces), inner), False)
        mesh = Mesh(*together((vertices, faces), inner, decoy), False)
        for point in np.random.default_rng(0).uniform(-2.5, 2.5, (50, 3)):
            assert mesh.holds(point) == plain.holds(point) == bool((np.abs(point) < 2).all())


@pytest.mark.parametrize("missing", [False, True])
def test_a_body_whose_sides_are_all_shared_is_solid(missing: bool) -> None:
    """All its walls were there in both orientations, and left out; then a hole in a neighbour opened all of them."""
    vertices, faces = cube(4)
    places = [(0, 0, 0), *(4 * side * axis for axis in np.eye(3) for side in (1, -1))]
    boxes = [(vertices + place, faces) for place in places]
    if missing:
        far = vertices[faces][:, :, 0].min(axis=1) == 2  # Its side at x = 6.
        boxes[1] = (boxes[1][0], np.delete(faces, np.flatnonzero(far)[0], axis=0))
    mesh = Mesh(*together(*boxes), False)
    assert mesh.closed != missing
    for k, place in enumerate(places):
        assert mesh.holds(CENTRE + place) or (missing and k == 1)
    assert not mesh.holds(np.array([3.0, 3.1, 0.2]))


def lobes() -> np.ndarray:
    """Corners of one closed surface of two pyramids that a thin tube connects; one is inside out, (f, 3, 3)."""
    angles = np.array([0.0, 2.0, 4.0]) * np.pi / 3.0
    ring = np.column_stack([np.cos(angles), np.sin(angles)])
    pairs = [(0, 1), (1, 2), (2, 0)]
    parts, tops = [], []
    for size, x in ((10.0, 15.0), (8.0, 0.0)):
        base, top = (
            np.column_stack([ring * r + [x, 0], np.full(3, z)])
            for r, z in ((size, -size / 2), (5e-5, size / 2))
        )
        parts.append(
            [
                base[[0, 2, 1]],
                *(
                    np.array(f)
                    for i, j in pairs
                    for f in ((base[i], base[j], top[j]), (base[i], top[j], top[i]))
                ),
            ]
        )
        tops.append(top)
    (p, n) = tops
    tube = [np.array(f) for i, j in pairs for f in ((p[i], p[j], n[j]), (p[i], n[j], n[i]))]
    return np.array([*parts[0], *tube, *(triangle[::-1] for triangle in parts[1])])


def test_simplifying_makes_no_cavities_and_keeps_those_that_are_there(tmp_path: Path) -> None:
    """The tube was cut, and the lobe inside out became a cavity of the box around it."""
    vertices, faces = cube(60)
    corners = np.concatenate([vertices[faces], lobes()]).reshape(-1, 3)
    write_obj(tmp_path / "lobes.obj", corners, np.arange(len(corners)).reshape(-1, 3))
    for tolerance in (None, 0.001):
        mesh = Mesh.read(tmp_path / "lobes.obj", hull=False, simplify=tolerance)
        assert mesh.closed
        assert mesh.holds(np.array([0.1, 0.2, -1.0]))
    write_obj(tmp_path / "room.obj", *nested(2))
    for tolerance in (None, 0.001):
        mesh = Mesh.read(tmp_path / "room.obj", hull=False, simplify=tolerance)
        assert not mesh.holds(np.array([0.1, 0.2, 0.1]))
        assert mesh.holds(np.array([0.75, 0.0, 0.0]))
        assert pickle.loads(pickle.dumps(mesh)).holds(np.array([0.75, 0.0, 0.0]))
    assert len(mesh.bounds) > 0


def test_simplified_meshes_of_one_file_are_equal_whatever_the_random_factors_are(tmp_path: Path) -> None:
    vertices, faces = together(cube(4), cube(4, 4.0, True))
    faces = np.random.default_rng(0).permutation(faces)
    write_obj(tmp_path / "cells.obj", vertices, faces)
    one, *others = (Mesh.read(tmp_path / "cells.obj", hull=False, simplify=0.001) for _ in range(20))
    assert np.abs(one.times).max() > 1
    assert all((one.times != other.times).any() for other in others)
    assert all(one == other for other in others)
    assert pickle.loads(pickle.dumps(one)).holds(CENTRE)


@pytest.mark.parametrize("crossed", [False, True])
def test_a_cavity_that_crosses_itself_is_solid_where_it_is_oriented_as_the_body_around_it(
    crossed: bool,
) -> None:
    """Also where another cavity crosses it."""
    vertices, faces = cube(60)
    room = cube(3)[0][cube(3)[1]][:, ::-1] + [0, 0, -1]
    corners = np.concatenate([vertices[faces], lobes()[:, ::-1], room[: 12 * crossed]]).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)
    assert not mesh.holds(np.array([15.1, 0.2, -1.0]))
    assert mesh.holds(np.array([0.1, 0.2, -1.0]))
    assert mesh.holds(np.array([-20.0, 0.2, -1.0]))


@pytest.mark.parametrize("first", [False, True])
def test_a_body_in_a_room_that_crosses_itself_is_solid(first: bool) -> None:
    """The volumes of the lobes nearly cancel, so that the body counted as larger than the room, and as a cavity of it."""
    solid, (vertices, faces) = cube(60), cube(2)
    body = vertices[faces] + [15, 0, -2]
    room = lobes()[:, ::-1]
    parts = [solid[0][solid[1]], room, body]
    corners = np.concatenate(parts[::-1] if first else parts).reshape(-1, 3)
    small = (np.abs(corners[:, 0]) < 9) & (np.abs(corners[:, 2] + 4) < 1e-9)
    for larger in (0.0, 4.0, 7.45):  # The height of the smaller lobe [m].
        moved = corners.copy()
        moved[small, 2] -= larger
        mesh = Mesh(moved, np.arange(len(moved)).reshape(-1, 3), False)
        assert mesh.holds(np.array([15.1, 0.2, -2.1]))
        assert not mesh.holds(np.array([15.1, 0.2, -4.1]))


@pytest.mark.parametrize("tolerance", [None, 1e-5, 0.002, 0.004])
def test_simplifying_a_surface_away_leaves_the_one_around_it(tolerance: float | None, tmp_path: Path) -> None:
    """An open skin fell onto the box around it: each triangle was there in both orientations, and nothing was solid."""
    (skin, faces), hole = cube(4 - 6e-4, inverted=True), 1e-4
    a, b, c = skin[faces[0]]
    p, r = a + hole * (b - a), a + hole * (c - a)
    corners = np.concatenate([skin[faces[1:]], [[p, b, c], [p, c, r]]]).reshape(-1, 3)
    whole = together(cube(4), (corners, np.arange(len(corners)).reshape(-1, 3)))
    write_obj(tmp_path / "skin.obj", *whole)
    mesh = Mesh.read(tmp_path / "skin.obj", hull=False, simplify=tolerance)
    assert mesh.holds(CENTRE)
    assert not mesh.closed
    assert not mesh.holds(SIDE)


SHEET = cube(4)[0], cube(4)[1][:2]
BESIDE = cube(4, 4.0)[0], np.delete(cube(4)[1], 4, axis=0)


@pytest.mark.parametrize(
    "parts",
    [(SHEET, cube(4)), (BESIDE, cube(4)), (SHEET, BESIDE, cube(4), SHEET), (cube(4, 4.0), SHEET, cube(4))],
)
@pytest.mark.parametrize("flipped", [False, True])
def test_an_open_surface_takes_no_inside_away(
    parts: tuple[tuple[np.ndarray, np.ndarray], ...], flipped: bool
) -> None:
    """Of a closed body that shares edges with an open surface before it in the file, no inside was left."""
    first = (parts[0][0], parts[0][1][:, ::-1]) if flipped else parts[0]
    mesh = Mesh(*together(first, *parts[1:]), False)
    assert mesh.holds(CENTRE)
    assert not mesh.holds(np.array([0.013, 3.02, 0.03]))


@pytest.mark.parametrize("turned", [(), (1, 4, 7)])
@pytest.mark.parametrize(
    "rows",
    [
        np.repeat(np.arange(12), 2),
        np.repeat(np.arange(12), 3),
        [0, *range(12)],
        [*range(12), 11],
        np.random.default_rng(0).permutation(np.repeat(np.arange(12), 2)),
    ],
    ids=["each twice", "three times", "the first twice", "the last twice", "twice, in any order"],
)
@pytest.mark.parametrize("beside", [False, True])
def test_repeated_triangles_change_no_inside(rows: Any, turned: tuple[int, ...], beside: bool) -> None:
    """Two equal triangles were taken for a closed surface of their own, and the rest for an open one."""
    vertices, faces = turned_over(cube(4), *turned)
    box = vertices, faces[np.asarray(rows)]
    vertices, faces = together(box, cube(4, 4.0)) if beside else box
    mesh = Mesh(vertices, faces, False)
    assert mesh.holds(CENTRE)
    assert mesh.holds(np.array([3.9, 0.1, 0.2])) == beside
    assert not mesh.holds(np.array([0.013, 3.02, 0.03]))


def block(low: list[float], high: list[float], inverted: bool = False) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = cube(1, inverted=inverted)
    return (vertices + 0.5) * np.subtract(high, low) + low, faces


FURNITURE = block([-2, -2, -2], [2, 2, 0])
"""A block on the whole floor of a room, whose bottom and floor are the same triangles."""


@pytest.mark.parametrize("repeated", [None, 1, 2])
@pytest.mark.parametrize("sheet", [False, True])
@pytest.mark.parametrize("order", [(0, 1, 2), (0, 2, 1), (2, 0, 1)])
def test_furniture_that_shares_the_floor_of_a_room_is_solid(
    order: tuple[int, ...], sheet: bool, repeated: int | None
) -> None:
    """With one repeated triangle the room was hollow in its furniture, and with an open sheet at a wall solid in the air."""
    bodies = [cube(6), block([-2, -2, -2], [2, 2, 2], inverted=True), FURNITURE]
    if repeated is not None:
        bodies[repeated] = bodies[repeated][0], bodies[repeated][1][[0, 1, 2, 3, 3, *range(4, 12)]]
    parts = [bodies[k] for k in order]
    if sheet:
        parts.insert(0, (np.array([[2.0, 2, 2], [2, 2, -2], [1, 1, 0]]), np.array([[0, 1, 2]])))
    mesh = Mesh(*together(*parts), False)
    assert mesh.holds(np.array([0.1, 0.2, -1.1]))
    # Where a triangle is repeated, all that is enclosed is solid.
    assert mesh.holds(np.array([0.1, 0.2, 1.1])) == (repeated is not None)
    assert mesh.holds(np.array([0.1, 0.2, 2.5]))
    assert mesh.closed != sheet


@pytest.mark.parametrize("order", ["between", "beside", "by normal", "shuffled"])
@pytest.mark.parametrize("in_turn", [False, True])
def test_a_two_sided_body_is_solid_wherever_its_triangles_are(order: str, in_turn: bool) -> None:
    """Its triangles cancelled each other in the middle of another body, which has sides in common with it."""
    vertices, faces = cube(4)
    both = np.stack([faces, faces[:, ::-1]], axis=int(in_turn)).reshape(-1, 3)
    beside = vertices * [-1, 1, 1] + np.array([4, 0, 0])  # The side in common has the same triangles.
    corners = np.concatenate([vertices[both], beside[faces[:, ::-1]]])
    rows = np.arange(36)
    if order == "between":
        rows = np.array([*range(24, 30), *range(24), *range(30, 36)])
    elif order == "by normal":
        normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        rows = np.lexsort(normals.round(6).T)
    elif order == "shuffled":
        rows = np.random.default_rng(1).permutation(36)
    mesh = Mesh(corners[rows].reshape(-1, 3), np.arange(108).reshape(-1, 3), False)
    assert mesh.holds(CENTRE)
    assert mesh.holds(CENTRE + np.array([4, 0, 0]))
    assert not mesh.holds(np.array([0.013, 3.02, 0.03]))


@pytest.mark.parametrize("order", ["AKBFB", "AKBBF", "KBFBA", "AKBF", "ABKBF", "ABFB", "FBKA"])
def test_a_body_that_is_there_twice_takes_nothing_of_others(order: str) -> None:
    """A room lost its floor to the foundation below it, and took that of the furniture, which was hollow then."""
    vertices, faces = FURNITURE
    bottom_last = np.argsort(vertices[faces][:, :, 2].max(axis=1) == -2, kind="stable")
    bodies = {
        "A": cube(12),
        "K": (vertices * [1, 1, -1] - [0, 0, 4], faces[:, ::-1]),  # Its top is the bottom of the other.
        "B": block([-2, -2, -2], [2, 2, 2], inverted=True),
        "F": (vertices, faces[bottom_last]),
    }
    mesh = Mesh(*together(*(bodies[each] for each in order)), False)
    assert mesh.holds(np.array([0.1, 0.2, -1.1]))
    assert not mesh.holds(np.array([0.1, 0.2, 1.1]))
    assert mesh.holds(np.array([0.1, 0.2, 5.5]))


@pytest.mark.parametrize("order", ["ARF", "RAF", "FAR", "ArF", "AfR", "aF", "aRF", "bF", "bR"])
def test_what_fills_a_room_is_solid(order: str) -> None:
    """It was taken for the room again, which is a cavity; and both sides of a body for the one that came first."""
    (outer, outward), (inner, faces) = cube(8), cube(4)
    outer, inner = outer[outward], inner[faces]
    bodies = {"A": outer, "R": inner[:, ::-1], "F": inner}
    for name, one in (("a", outer), ("b", outer[:, ::-1]), ("f", inner), ("r", inner[:, ::-1])):
        bodies[name] = np.stack([one, one[:, ::-1]], axis=1).reshape(
            -1, 3, 3
        )  # Each triangle, and turned over.
    corners = np.concatenate([bodies[name] for name in order]).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)
    assert mesh.closed
    assert mesh.holds(CENTRE)
    assert mesh.holds(np.array([0.013, 0.02, 3.1]))


def test_open_surfaces_before_and_after_bodies_take_nothing_of_them() -> None:
    """Each triangle was in a closed surface of triangles in turn, but the furniture was in none of them."""

    def parted(mesh: tuple[np.ndarray, np.ndarray], z: float) -> tuple[np.ndarray, np.ndarray]:
        corners = mesh[0][mesh[1]]
        there = (corners[:, :, 2] == z).all(axis=1)
        return corners[~there], corners[there]

    below, _ = parted(block([-2, -2, -4], [2, 2, -2]), -2)
    walls, floor = parted(block([-2, -2, -2], [2, 2, 2], inverted=True), -2)
    sides, bottom = parted(FURNITURE, -2)
    lid, _ = parted(block([-2, -2, -2], [2, 2, -1]), -2)
    lid[lid[:, :, 2] == -1] *= [0.5, 0.5, 1]
    solid, other = cube(20), block([-3, -3, -3], [1, 1, 3], inverted=True)
    parts = [solid[0][solid[1]], below, floor, walls, sides, bottom, lid, other[0][other[1]]]
    corners = np.concatenate(parts).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)
    assert mesh.holds(np.array([0.1, 0.2, -1.1]))
    assert mesh.holds(np.array([-1.1, 0.2, -0.1]))


def voxels(occupied: np.ndarray) -> np.ndarray:
    """The triangles between occupied and other cells of a grid with edges of 1 m, seen from outside, (f, 3, 3)."""
    cells, found = np.pad(occupied, 1), []
    for cell, axis, side in itertools.product(np.argwhere(cells), range(3), (0, 1)):
        step = np.eye(3, dtype=int)[axis]
        if cells[tuple(cell + (2 * side - 1) * step)]:
            continue
        u, v = np.eye(3, dtype=int)[[(axis + 1) % 3, (axis + 2) % 3]]
        corners = cell - 1 + side * step + np.array([0 * u, u, u + v, v])
        found += (
            [corners[[0, 1, 2]], corners[[0, 2, 3]]] if side else [corners[[2, 1, 0]], corners[[3, 2, 0]]]
        )
    return np.array(found, dtype=float)


@pytest.mark.parametrize("pinched", ["inside", "outside"])
def test_a_room_is_hollow_also_where_a_surface_touches_itself(pinched: str) -> None:
    """Of a body with an edge of four of its triangles was not known any more how it is oriented."""
    cells = np.ones((2, 2, 2), dtype=bool)
    cells[0, 0, 0] = cells[1, 1, 0] = False  # Two cells that touch at an edge, joined above.
    small = voxels(cells) + 1
    inner = small if pinched == "inside" else (cube(0.4)[0] + [1.5, 2.5, 1.5])[cube(0.4)[1]]
    outer = (cube(8)[0])[cube(8)[1]] if pinched == "inside" else small
    corners = np.concatenate([outer, inner[:, ::-1]]).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)
    assert mesh.closed
    assert not mesh.holds(np.array([1.51, 2.53, 1.52]))
    assert mesh.holds(np.array([1.47, 1.51, 1.53])) == (pinched == "inside")
    assert mesh.holds(np.array([1.1, 2.1, 1.9])) == (pinched == "outside")


def test_long_thin_bodies_hold_no_points_beside_them() -> None:
    """The sum of their surfaces has large factors, which rounding errors of needles exceeded."""
    (vertices, faces), size = cube(1), np.array([20_000.0, 0.02, 0.02])
    bars = together((vertices * size, turned_over(cube(1), 0)[1]), (vertices * size + [0, 0.02, 0], faces))
    turn = kinseek.pose([0, 0, 0], rpy=[0.3, -0.2, 0.5])[:3, :3]
    mesh = Mesh(bars[0] @ turn.T, bars[1], False)
    mesh.holds(bars[0][bars[1][0, :2]].mean(axis=0) @ turn.T)  # The middle of an edge: nothing overflows.
    points = np.column_stack([np.linspace(-9000, 9000, 200), np.full(200, 0.005), np.full(200, 0.02)])
    assert not any(mesh.holds(turn @ point) for point in points)
    assert all(mesh.holds(turn @ (point * [1, 1, 0.1])) for point in points)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("flipped", [False, True])
def test_a_wall_before_a_body_takes_no_half_of_it_away(axis: int, flipped: bool) -> None:
    """With half of the body the wall was a body; of the other half, only the air beside it was solid."""
    shell, block, half, places = (np.zeros((5, 5, 5), dtype=bool) for _ in range(4))
    shell[:], shell[1:4, 1:4, 1:4], block[2:4, 2, 1:4], half[2, 2, 1:4] = True, False, True, True
    places[:, :, :3] = True
    wall = voxels(half)
    wall = wall[(wall[:, :, 0] == 3).all(axis=1)]
    parts = [
        voxels(shell & places),
        voxels(shell & ~places),
        wall[:, ::-1] if flipped else wall,
        voxels(block),
    ]
    corners = np.roll(np.concatenate(parts), axis, axis=2).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)
    assert all(
        mesh.holds(np.roll(np.add(cell, [0.31, 0.27, 0.43]), axis)) for cell in np.argwhere(block | shell)
    )


@pytest.mark.parametrize("again", [False, True])
@pytest.mark.parametrize("order", [(0, 3, 1, 4, 5, 2), (1, 2, 3, 2, 5, 0), (3, 0, 1, 2, 5)])
def test_repeating_a_triangle_of_furniture_changes_no_inside(order: tuple[int, ...], again: bool) -> None:
    """All that is repeated was left out: then one room had no floor, and the furniture no bottom, and was hollow."""
    vertices, faces = FURNITURE
    faces = faces[np.argsort(vertices[faces][:, :, 2].max(axis=1) == -2, kind="stable")]
    bodies = [
        block([-2, -2, -6], [2, 2, -2], inverted=True),  # A room below the floor,
        block([-2, -2, -3], [2, 2, -2]),  # and what is under its ceiling.
        block([-2, -2, -2], [2, 2, 2], inverted=True),
        cube(20),
        block([-2, -2, -2], [2, 2, 4], inverted=True),
        (vertices, faces[[0, *range(12)] if again else range(12)]),
    ]
    mesh = Mesh(*together(*(bodies[k] for k in order)), False)
    assert mesh.holds(np.array([0.1, 0.2, -1.1]))
    assert mesh.closed


@pytest.mark.parametrize("order", list(itertools.permutations("PtG")))
def test_panels_and_a_partition_take_nothing_of_a_body_away(order: tuple[str, ...]) -> None:
    """The partition closed one half; each triangle of the other one was also that of a panel, so it was left out."""
    whole = voxels(np.ones((2, 1, 1), dtype=bool))
    first = whole.mean(axis=1)[:, 0] < 1
    sides = np.array([[1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    one = voxels(np.ones((1, 1, 1), dtype=bool))
    panels = [one * (1 - 0.9 * np.abs(side)) + np.maximum(side, 0) * 0.9 + [1, 0, 0] for side in sides]
    parts = {
        "P": np.concatenate(panels),
        "t": np.array([[[1, 0, 0], [1, 1, 0], [1, 1, 1]], [[1, 0, 0], [1, 1, 1], [1, 0, 1]]], dtype=float),
        "G": np.concatenate([whole[first], whole[~first]]),
    }
    corners = np.concatenate([parts[name] for name in order]).reshape(-1, 3)
    mesh = Mesh(corners, np.arange(len(corners)).reshape(-1, 3), False)
    assert mesh.holds(np.array([1.51, 0.53, 0.47]))
    assert mesh.holds(np.array([0.51, 0.53, 0.47]))
    assert not mesh.holds(np.array([2.51, 0.53, 0.47]))


def test_what_dirty_bodies_of_many_patches_enclose_is_solid() -> None:
    """A wall of 1,728 boxes with one triangle twice, or with triangles turned over, in any order."""
    rng = np.random.default_rng(0)
    places = np.stack(np.meshgrid(*[np.arange(12.0)] * 3), axis=-1).reshape(-1, 3)
    one = voxels(np.ones((1, 1, 1), dtype=bool))
    corners = (one + places[:, None, None]).reshape(-1, 3, 3)
    turned = np.where(rng.random((len(corners), 1, 1)) < 0.5, corners, corners[:, ::-1])
    for each in (np.concatenate([corners, corners[:1]]), rng.permutation(turned)):
        inside = Interior(each.reshape(-1, 3), np.arange(3 * len(each)).reshape(-1, 3))
        assert inside.closed
        assert all(inside.holds(place + rng.uniform(0.1, 0.9, 3)) for place in places[::9])
        assert not inside.holds(np.array([-0.1, 3.1, 4.2]))


def test_the_marks_of_triangles_are_not_known() -> None:
    """With marks that everybody knows, the triangles of a body could be ordered so that an open part adds up to 0."""
    corners = cube(4)[1]
    one, other = (
        closed_surfaces._triangles(corners, *closed_surfaces._edges(corners)).marks[0] for _ in range(2)
    )
    assert one != other


@pytest.mark.parametrize("order", ["ABAB", "AAB", "ABB", "AABB", "BA", "BABA", "aAB", "ABb", "AabB", "AbBa"])
def test_a_room_that_is_there_twice_is_hollow(order: str) -> None:
    bodies = {"A": cube(4), "B": cube(3, inverted=True)}
    bodies |= {name.lower(): (vertices, faces[:1]) for name, (vertices, faces) in bodies.items()}
    mesh = Mesh(*together(*(bodies[each] for each in order)), False)
    assert not mesh.holds(CENTRE)
    assert mesh.holds(WALL)


def test_surfaces_that_enclose_nothing_take_little_time() -> None:
    """Three triangles at one edge, anywhere, made each lone triangle take 0.6 ms; and cubes in a row repeated millions."""
    rng, began = np.random.default_rng(0), time.process_time()
    corners = rng.uniform(-1, 1, (60_000, 3, 3))
    corners[1:3, :2] = corners[0, :2]
    assert not Interior(corners.reshape(-1, 3), np.arange(180_000).reshape(-1, 3)).any_solid
    row = [cube(1, float(k)) for k in range(300)]
    sides = [
        (vertices, np.delete(faces, np.flatnonzero(np.ptp(vertices[faces][:, :, 0], axis=1) == 0), axis=0))
        for vertices, faces in row
    ]
    walls = [(vertices, faces[np.ptp(vertices[faces][:, :, 0], axis=1) == 0]) for vertices, faces in row]
    inner = Interior(*together(*sides, *walls, (row[0][0], walls[0][1][:1])))
    assert all(inner.holds(np.array([k + 0.31, 0.27, 0.13])) for k in range(300))
    assert time.process_time() - began < 20


def test_triangles_of_bodies_that_are_oriented_alike_may_come_in_any_order() -> None:
    """A triangle of both was taken for a closed surface if it came twice in a row."""
    vertices, faces = together(cube(4), ((cube(4)[0] + 2) * [0.8, 1, 1] - 2, cube(4)[1]))
    rng = np.random.default_rng(0)
    for _ in range(500):
        mesh = Mesh(vertices, rng.permutation(faces), False)
        assert mesh.holds(CENTRE)
        assert mesh.holds(np.array([1.9, 0.1, 0.2]))


def test_materials_of_an_obj_do_not_change_the_order_of_its_triangles(tmp_path: Path) -> None:
    """The tops of both boxes came last, and nothing told any longer that the one inside out is solid, too."""
    low, inner = cube(4), cube(2, inverted=True)
    vertices, faces = together(low, (inner[0] + [1, 0, 1], inner[1]))
    plain = write_obj(tmp_path / "plain.obj", vertices, faces)
    rows, surfaces = (
        [row for row in plain.read_text().splitlines() if row.startswith(kind)] for kind in "vf"
    )
    top = (np.ptp(vertices[faces][:, :, 2], axis=1) == 0) & (vertices[faces][:, 0, 2] > 0)
    painted = tmp_path / "painted.obj"
    looks = [f"usemtl {'top' if each else 'side'}" for each in top]
    painted.write_text("\n".join(rows + [row for pair in zip(looks, surfaces, strict=True) for row in pair]))
    meshes = [Mesh.read(path, hull=False) for path in (plain, painted)]
    np.testing.assert_array_equal(meshes[0].vertices[meshes[0].faces], meshes[1].vertices[meshes[1].faces])
    assert all(mesh.holds(np.array([1.5, 0.1, 1.5])) for mesh in meshes)
    assert top.any()


def test_a_thin_surface_has_an_inside() -> None:
    vertices, faces = cube(1)
    for size in ([10, 1e-5, 1e-5], [1, 1, 1e-8]):
        mesh = Mesh(vertices * size, faces, False)
        assert mesh.closed
        assert mesh.holds(np.array([0.3, 1e-6, 1e-9]))


def test_a_surface_without_an_inside_is_open() -> None:
    mesh = Mesh(*klein(), False)
    assert not mesh.closed
    assert not mesh.interior.any_solid


def nested(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Boxes in each other, the largest first, every second one inside out."""
    return together(*(cube(count - k, inverted=k % 2 == 1) for k in range(count)))


def test_surfaces_in_each_other_are_compared_with_the_next_one_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """A file of 80 kB took 30 s, and one of twice as many surfaces four times as long."""
    calls = list[int]()

    def counted(self: Interior, outer: int, inner: int, *more: Any, real: Any = Interior._encloses) -> bool:
        calls.append(inner)
        return bool(real(self, outer, inner, *more))

    monkeypatch.setattr(Interior, "_encloses", counted)
    mesh = Mesh(*nested(40), False)
    for k in range(40):  # A box is solid, the next one in it hollow.
        assert mesh.holds(np.array([(40 - k - 0.5) / 2, 0.01, 0.02])) == (k % 2 == 0)
    assert len(calls) == 39


def test_without_cavities_where_too_much_had_to_be_compared() -> None:
    began = time.process_time()
    mesh = Mesh(*nested(3000), False)
    assert mesh.holds(np.array([1499.25, 0.01, 0.02]))
    assert time.process_time() - began < 20


def saddles(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Two bodies in each other, each below a saddle of long triangles; those of one cross those of the other closely."""

    def body(size: float, turned: bool, lift: float, apex: float) -> tuple[np.ndarray, np.ndarray]:
        t = np.linspace(-size, size, count + 1)
        sides = [np.column_stack([np.full(count + 1, x), t, x * t + lift]) for x in (-size, size)]
        vertices = np.concatenate([*sides, [[0.0, 0.0, apex]]])
        if turned:
            vertices = vertices[:, [1, 0, 2]]
        i, top = np.arange(count), 2 * (count + 1)
        j, tip = count + 1 + i, np.full(count, top)
        faces = [(i, j, j + 1), (i, j + 1, i + 1), (i + 1, tip, i), (j, tip, j + 1)]
        ends = [[0, top, count + 1], [count, 2 * count + 1, top]]
        return vertices, np.concatenate([*(np.column_stack(each) for each in faces), ends])

    outer, inner = body(1.1, True, 4.4 / count, -5.0), body(1.0, False, 0.0, -3.0)
    return together(outer, inner)


def test_surfaces_that_nearly_touch_everywhere_are_compared_for_seconds_at_most(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A file of 1.6 MB took 48 s, which nothing interrupts, and 128,000 triangles more than 200 s."""
    hollow = np.array([0.0, 0.0, -1.0])
    assert not Mesh(*saddles(100), False).holds(hollow)
    monkeypatch.setattr(interior, "_AT_ONCE", 1)
    monkeypatch.setattr(interior, "_PAIRS_AT_ONCE", 1)
    assert not Mesh(*saddles(100), False).holds(hollow)
    monkeypatch.setattr(interior, "_COMPARED_IN_A_SECOND", 2**50)
    with pytest.raises(InvalidScene, match="the mesh: to find its cavities takes too long"):
        assert Mesh(*saddles(100), False).closed


def test_surfaces_of_the_meshes_of_a_file_are_compared_for_seconds_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A mesh of 72 kB took 3.5 s, and a file of obstacles may name it with 900 factors of scale."""
    write_stl(tmp_path / "a.stl", *nested(40))
    monkeypatch.setattr(interior, "_COMPARED_IN_A_SECOND", 0)  # The time differs from call to call.
    one = Mesh(*nested(40), False).interior.compared
    assert one > 500 * 40 * 39 / 2
    scene = Scene.of(kinseek.load("planar2"), capsules=0.05)

    def add(name: str, *scales: int) -> None:
        shapes = "".join(
            f'<collision><geometry><mesh filename="a.stl" scale="1 1 {scale}"/></geometry></collision>'
            for scale in scales
        )
        (tmp_path / "cell.urdf").write_text(f'<robot name="r"><link name="{name}">{shapes}</link></robot>')
        scene.add_file(tmp_path / "cell.urdf")

    monkeypatch.setattr(obstacles, "MOST_COMPARED", one)
    add("often", 1, 2, 1, 2)
    with pytest.raises(InvalidScene, match="up to 'more' have too many surfaces"):
        add("more", 1, 2, 3)
    assert scene.bodies[-1] == "often"


def test_surfaces_with_an_inside_are_told_from_open_ones(tmp_path: Path) -> None:
    arm = kinseek.load("planar2")
    q = [0.0, 0.1]
    scene = Scene.of(arm, capsules=0.02)
    # The links alone are neighbours, as a note says.
    scene.add_box("far", (0.1, 0.1, 0.1), kinseek.pose([7.0, 0.0, 0.0]))
    for name, words, free in (
        ("4 turned over", None, False),
        ("room", None, True),
        ("box beside a sheet", "is an open mesh in part: .* its open surfaces", False),
        ("lid off, both sides", "is an open mesh, a surface", True),
        ("both sides", None, False),
    ):
        before = len(scene.notes)
        scene.add_mesh("part", write_stl(tmp_path / "part.stl", *SURFACES[name][0]))
        assert scene.free(q) == free
        assert len(scene.notes) == before + (words is not None)
        assert words is None or re.search(words, scene.notes[-1])
        scene.remove("part")


def test_bodies_of_one_mesh_share_its_triangles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that names a small mesh 1,900 times took 9 GB."""
    write_stl(tmp_path / "part.stl", *SURFACES["room"][0])
    link = (
        '<link name="l{0}"><collision><origin xyz="0 0 {0}"/><geometry><mesh filename="part.stl"/></geometry></collision>'
        '</link><joint name="j{0}" type="fixed"><parent link="base"/><child link="l{0}"/></joint>'
    )
    links = "".join(link.format(i) for i in range(1, 7))
    (tmp_path / "cell.urdf").write_text(f'<robot name="c"><link name="base"/>{links}</robot>')
    made = list[Any]()

    def make(*mesh: Any) -> Any:
        made.append(mesh)
        return triangles(*mesh)

    monkeypatch.setattr(shapes, "triangles", make)
    scene = Scene.of(kinseek.load("planar2"), capsules=0.02)
    scene.add_file(tmp_path / "cell.urdf")
    nearest = scene.distance([0.0, 0.1])
    assert len(made) == 1
    assert pickle.loads(pickle.dumps(scene)).distance([0.0, 0.1]) == nearest


PYRAMID = (
    np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
)


def test_a_link_wholly_inside_a_mesh_touches_it(tmp_path: Path) -> None:
    """The middle of the link's bounding box lies outside of the link, and outside of the mesh around it."""
    vertices, faces = PYRAMID
    write_stl(tmp_path / "link.stl", 0.09 * vertices, faces)
    file = tmp_path / "arm.urdf"
    file.write_text(
        """<robot name="r"><link name="base"/><link name="hand"><collision><geometry><mesh filename="link.stl"/></geometry>
        </collision></link><joint name="j" type="prismatic"><parent link="base"/><child link="hand"/><axis xyz="1 0 0"/>
        <limit lower="-1" upper="1" velocity="1" effort="1"/></joint></robot>"""
    )
    scene = Scene.of(kinseek.load(file))
    scene.add_mesh("rock", write_stl(tmp_path / "rock.stl", 0.12 * vertices - 0.005, faces))
    q = np.array([[0.0], [0.001], [0.5]])
    assert scene.free(q).tolist() == [False, False, True]
    assert [len(scene.hits(one)) for one in q] == [1, 1, 0]
    assert scene.distance(q[0]) < 0
    assert not scene.free_motion([0.0], [0.001])


@pytest.mark.parametrize("less", [1e-7, 1e-7 + 1e-9])
def test_corners_that_differ_by_rounding_stay_together_when_simplified(less: float) -> None:
    """A box whose corners lay at the edge of a cell, 2e-10 m apart in different triangles, was opened, and free inside."""
    cell = 2 * (0.002 - less) / np.sqrt(3.0)
    k = min(range(1000, 1300), key=lambda k: abs(k * cell * 1e9 - round(k * cell * 1e9)))
    places, rng = np.array([0.0, (k - 0.5) * cell, k * cell]), np.random.default_rng(0)
    corners = []
    for axis, side, i, j in itertools.product(range(3), (0, 2), (0, 1), (0, 1)):
        square = np.array([[side, i + a, j + b] for a, b in ((0, 0), (1, 0), (1, 1), (0, 1))])
        for triangle in ([0, 1, 2], [0, 2, 3]):
            corners.append(np.roll(square[triangle[:: 1 if side else -1]], axis, axis=1))
    grid = np.concatenate(corners)
    vertices = places[grid] + np.where(grid == 2, rng.uniform(-2e-10, 2e-10, grid.shape), 0.0)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    assert Mesh(vertices, faces, False).closed
    simple, triangles, moved, _ = simplified(vertices, faces, 0.002)
    assert moved <= 0.002
    mesh = Mesh(simple, triangles, False)
    assert mesh.closed
    assert mesh.holds(places[[1, 1, 1]])


def test_a_mesh_is_oriented_before_it_is_simplified(tmp_path: Path) -> None:
    vertices, faces = ball(0.1)
    faces[::3] = faces[::3, ::-1]
    file = write_stl(tmp_path / "part.stl", vertices, faces)
    mesh = Mesh.read(file, hull=False, simplify=0.02)
    assert mesh.closed
    assert mesh.holds(np.zeros(3))


@pytest.mark.slow
def test_simplifying_is_asked_for_and_said(tmp_path: Path) -> None:
    arm = kinseek.load("ur5e")
    scene, fine = Scene.of(arm, capsules=0.05), Scene.of(arm, capsules=0.05)
    file = write_stl(tmp_path / "ball.stl", *ball(0.15, 3))
    notes = len(scene.notes)
    place = kinseek.pose([0.5, 0.0, 0.4])
    fine.add_mesh("part", file, place)
    assert len(fine.notes) == notes
    scene.add_mesh("part", file, place, simplify=0.02)
    assert "'part' is simplified to" in scene.notes[-1]
    thicker = scene._bodies["part"].parts[0].shape.thickness
    assert 0.005 < thicker <= 0.02
    assert f"{thicker:.2g} m thicker" in scene.notes[-1]
    q = arm.sample(60, seed=1)
    assert (scene.distance(q) <= fine.distance(q) + 2e-6).all()
    assert (
        scene.distance(q)[fine.distance(q) > 0] >= fine.distance(q)[fine.distance(q) > 0] - 2 * thicker - 2e-6
    ).all()
    assert not (scene.free(q) & ~fine.free(q)).any()
    scene.remove("part")
    assert len(scene.notes) == notes
    for wrong in (0.0, -1.0, np.nan, "fine", True):
        with pytest.raises(InvalidScene, match="simplify must be a length above 0 m"):
            scene.add_mesh("part", file, simplify=wrong)  # type: ignore[arg-type]


def test_too_many_triangles_are_refused_unless_it_is_said_what_to_do(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bound itself, a million, is tried in test_scene.py; here it is lower, for files that are read in no time."""
    monkeypatch.setattr("kinseek.collision.shapes.MOST_TRIANGLES", 1000)
    file = write_stl(tmp_path / "big.stl", *ball(0.15, 3))
    scene = Scene.of(kinseek.load("ur5e"), capsules=0.05)
    with pytest.raises(
        InvalidScene, match=r"1,280 triangles, expected at most 1,000: .*hull=True.*simplify=0\.001"
    ):
        scene.add_mesh("big", file)
    assert "big" not in scene.bodies
    with pytest.raises(InvalidScene, match="expected at most 1,000"):
        scene.add_mesh("big", file, simplify=1e-6)  # Too little to help.
    scene.add_mesh("big", file, simplify=0.04)
    scene.add_mesh("hull", file, hull=True)


def test_a_file_may_hold_more_than_a_page_would_show(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A scan of many triangles is read to be simplified; what the viewer draws has a lower bound."""
    file = write_stl(tmp_path / "big.stl", *ball(0.15, 2))
    monkeypatch.setattr("kinseek.meshes.parts.mesh_parts.__defaults__", (1000,))
    with pytest.raises(kinseek.InvalidRobot, match="expected at most 1,000"):
        mesh_parts(file)
    assert len(Mesh.read(file).faces) == 320
    monkeypatch.setattr("kinseek.collision.shapes.MOST_BYTES", 1000)
    with pytest.raises(InvalidScene, match="expected at most 1,000"):
        Mesh.read(file)


def test_a_missing_package_is_asked_for_by_the_right_name(tmp_path: Path) -> None:
    with pytest.raises(InvalidScene, match=r"'thick_meshes' with meshes=, or set .*skips such meshes"):
        Scene.of(kinseek.load(write_arm(tmp_path), tip="tip"))


@pytest.mark.slow
def test_a_xacro_file_with_arguments_is_known_again(tmp_path: Path) -> None:
    file = write_arm(tmp_path)
    text = file.read_text().replace(
        '<robot name="thick">',
        '<robot name="thick" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="long" default="0.4"/>',
    )
    text = text.replace('xyz="0 0 0.4"', 'xyz="0 0 $(arg long)"')
    path = file.with_name("thick.urdf.xacro")
    path.write_text(text)
    for long in (0.4, 0.6):
        arm = kinseek.load(
            path,
            tip="tip",
            args={"long": long},
            packages={"thick_meshes": tmp_path / "packages" / "thick_meshes"},
        )
        scene = Scene.of(arm.with_locked({"j6": 0.3}))
        plain = tmp_path / "robot" / f"plain{long}.urdf"
        plain.write_text(file.read_text().replace('xyz="0 0 0.4"', f'xyz="0 0 {long}"'))
        other = Scene.of(kinseek.load(plain, tip="tip"), [tmp_path / "packages"])
        q = arm.sample(50, seed=1)
        q[:, 5] = 0.3
        assert np.allclose(scene.distance(q[:, :5]), other.distance(q), atol=2e-6)
    with pytest.raises(InvalidScene, match="another arm, or a xacro file expanded with other arguments"):
        Scene.of(arm, urdf=path)


@pytest.mark.slow
def test_an_arm_from_text_knows_its_geometry(tmp_path: Path) -> None:
    file = write_arm(tmp_path)
    arm = kinseek.load(file.read_text().replace('"meshes/', f'"{file.parent}/meshes/'), tip="tip")
    scene = Scene.of(arm, [tmp_path / "packages"])
    other = Scene.of(kinseek.load(file, tip="tip"), [tmp_path / "packages"])
    q = arm.sample(50, seed=1)
    assert np.array_equal(scene.free(q), other.free(q))


def scattered(count: int) -> np.ndarray:
    """Points on a ball, as 32-bit numbers, which an STL file holds."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    return np.asarray(points / np.linalg.norm(points, axis=1)[:, None], dtype=np.float32).astype(np.float64)


def mesh_of(points: np.ndarray, hull: bool) -> Mesh:
    return Mesh(points, np.arange(len(points) // 3 * 3).reshape(-1, 3), hull)


def test_a_hull_of_too_many_corners_is_refused() -> None:
    """A file of 400 kB took more than a minute, and one of 10 MB did not end."""
    points = scattered(MOST_CORNERS + 2)
    with pytest.raises(
        InvalidScene, match=r"18,002 of its points may be .* at most 18,000: simplify the mesh"
    ):
        mesh_of(points, hull=True).geometry()
    # Triangles count themselves: the box around them bounds them.
    box = mesh_of(points, hull=False).corners
    assert box.shape == (8, 3)
    assert (box.min(axis=0) == points.min(axis=0)).all()
    assert (box.max(axis=0) == points.max(axis=0)).all()


@pytest.mark.parametrize("missing", ["error", "skip"])
def test_hulls_of_too_many_corners_together_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, missing: Literal["error", "skip"]
) -> None:
    """One file of 400 kB, named with 14 scales, took more than a minute."""
    monkeypatch.setattr(bodies, "MOST_HULL_CORNERS", 100)
    write_stl(tmp_path / "ball.stl", *ball(0.01, 1))  # Its hull has 42 corners.
    each = "".join(
        f'<collision><geometry><mesh filename="ball.stl" scale="1 1 {1 + i / 10}"/></geometry></collision>'
        for i in range(5)
    )
    urdf = tmp_path / "arm.urdf"
    urdf.write_text(
        f'<robot name="r"><link name="b"/><link name="t">{each}{each}</link><joint name="j" type="revolute">'
        '<parent link="b"/><child link="t"/><origin xyz="0 0 1"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>'
    )
    if missing == "error":
        with pytest.raises(InvalidScene, match=r"element 4: 'ball.stl': .* have 126 corners .* at most 100"):
            Scene.of(kinseek.load(urdf))
    else:
        notes = Scene.of(kinseek.load(urdf), missing=missing).notes
        assert [note.partition("element ")[2][:2] for note in notes] == ["4:", "5:", "9:", "10", ""]
        assert "no two bodies are checked" in notes[-1]  # The arm has one link with shapes.


def test_obstacles_whose_hulls_have_many_corners_together_are_boxed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first check of a scene took ten minutes for 1,500 meshes of 3,000 corners, from files of 213 kB."""
    monkeypatch.setattr(obstacles, "MOST_HULL_CORNERS", 100)
    write_stl(tmp_path / "ball.stl", *ball(0.1, 1))  # Its hull has 42 corners.
    each = "".join(
        f'<collision><origin xyz="{i / 4} 0.3 0"/><geometry><mesh filename="ball.stl" scale="1 1 {1 + i / 10}"/></geometry>'
        "</collision>"
        for i in range(5)
    )
    (tmp_path / "things.urdf").write_text(f'<robot name="r"><link name="b">{each}</link></robot>')
    arm = kinseek.load("scara4")
    some, none = (Scene.of(arm, capsules=0.05) for _ in range(2))
    some.add_file(tmp_path / "things.urdf")
    monkeypatch.undo()
    none.add_file(tmp_path / "things.urdf")
    parts = [scene._standing[0].parts for scene in (some, none)]
    count = [[len(part.shape.corners) for part in each] for each in parts]
    assert count == [[42, 42, 42, 8, 8], [42] * 5]
    q = arm.sample(300)
    assert (some.free(q) == none.free(q)).all()
    assert not some.free(q).all()


ROUGH = """
import numpy as np
from kinseek import InvalidScene
from kinseek.collision import Mesh
angles = np.linspace(0, 2 * np.pi, 4500, endpoint=False)
ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
points = np.concatenate([ring, ring + [0, 0, 1]])
for seed in range(2):  # Qhull fails on the first, and makes the second.
    noise = np.abs(np.random.default_rng(seed).normal(size=points.shape)[:, :1])
    mesh = Mesh(points * (1 - 1e-14 * noise), np.arange(9000).reshape(-1, 3))
    try:
        print(len(mesh.corners))
    except InvalidScene as error:
        print(error)
"""


@pytest.mark.slow
def test_sides_that_are_flat_but_for_rounding_do_not_end_the_process() -> None:
    done = subprocess.run([sys.executable, "-c", ROUGH], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    refused = ("cannot make its convex hull", "a flat side of its convex hull has ")
    assert all(any(words in line for words in refused) for line in done.stdout.splitlines())


THIN = """
import numpy as np
from kinseek.collision import Mesh
from kinseek.errors import InvalidScene

def read(far):
    angles = np.arange(80) * np.pi / 40
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    points = 1e-7 * np.concatenate([ring, ring + [0, 0, 1e-3]]) + far
    try:
        Mesh(points, [[0, 1, 2]]).geometry()
    except InvalidScene as error:
        print(error)
"""


@pytest.mark.slow
@pytest.mark.parametrize("far", [[1000.0, 0.0, 0.0], [646.0, -1595.0, -702.0]])
def test_a_mesh_too_thin_for_its_distance_does_not_end_the_process(far: list[float]) -> None:
    program = f"{THIN}\nread({far})"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "too thin for its distance from its origin" in done.stdout


NEAR = """
import numpy as np
from kinseek.collision import Mesh

wedge = np.array([
    [-7.973378046371029e-14, -2.258687073360409e-14, -6.514019090817033e-14],
    [0.0073171628989371915, -0.0027953713555403715, 0.002390300182380236],
    [-1.394374244775437e-14, 5.5990323455706045e-14, 3.271784778358558e-14],
    [0.007318051913684175, -0.0027942943659667427, 0.0023888382406624057],
    [0.0029711741043528723, 0.0020405923875459597, 0.0033100596173926025],
    [0.0029720631190013817, 0.0020416693772323394, 0.003308597675697954],
])
for seed in range(100):
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0] if seed else np.eye(3)
    corners = Mesh(wedge @ turn, [[0, 1, 2]]).corners
    assert 4 <= len(corners) <= 6, corners
"""


@pytest.mark.slow
def test_corners_that_nearly_coincide_do_not_end_the_process() -> None:
    """Where Qhull has a warning to print, coal's copy of it ends the process."""
    done = subprocess.run([sys.executable, "-c", NEAR], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("seed", [6, 17, 20])
def test_corners_that_nearly_coincide_do_not_hide_the_farthest_one(seed: int) -> None:
    """Hulls of corners 1e-14 apart are folded by rounding, and coal stopped at another corner: 0.107 m for 0.051 m."""
    rng = np.random.default_rng(seed)
    ball_points = rng.normal(size=(60, 3))
    ball_points *= 0.1 / np.linalg.norm(ball_points, axis=1, keepdims=True)
    points = np.repeat(ball_points, 5, axis=0) + 1e-15 * rng.normal(size=(300, 3))
    coal = pytest.importorskip("coal")
    hull, tiny = mesh_of(points, hull=True).geometry(), coal.Sphere(1e-9)
    for way in directions(400):
        place, result = coal.Transform3s(np.eye(3), way), coal.DistanceResult()
        coal.distance(hull, coal.Transform3s(), tiny, place, coal.DistanceRequest(), result)
        # No farther than the plane through the farthest corner, and no nearer than the hull is round.
        assert result.min_distance <= np.linalg.norm(points - way, axis=1).min()
        assert result.min_distance >= 1.0 - (points @ way).max() - 2e-9


def test_a_flat_side_is_found_wherever_it_is() -> None:
    """Of a disc of 16,000 corners on a ball few directions show three; Qhull took 26 s, in which nothing interrupts it."""
    angles = np.linspace(0.0, 2.0 * np.pi, 4000, endpoint=False)
    ring = np.stack(
        [0.05 * np.cos(angles), 0.05 * np.sin(angles), np.full(4000, np.sqrt(1 - 0.05**2))], axis=1
    )
    body = directions(400)
    points = np.concatenate([ring, body[body[:, 2] < 0.99]])
    with pytest.raises(InvalidScene, match=r"a flat side of its convex hull has 4,000 corners"):
        mesh_of(points, hull=True).geometry()


def test_many_surfaces_around_a_point_are_asked_at_once_and_counted() -> None:
    tetrahedron = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    many = [(tetrahedron * (1 + i / 2000), faces) for i in range(2000)]
    mesh = Mesh(*together(*many), False)
    assert mesh.holds(np.array([0.2, 0.2, 0.2]))
    assert not mesh.holds(np.array([0.9, 0.9, 0.9]))
    apart = [(tetrahedron + np.array([2 * i, 0, 0]), faces) for i in range(2000)]
    one_inward = [(apart[0][0], faces[:, ::-1]), *apart[1:]]
    assert Mesh(*together(*one_inward), False).interior.compared >= 2000 * 2000 // 4


def circles(corners: int) -> np.ndarray:
    """Two circles of so many corners each, rotated."""
    angles = np.linspace(0.0, 2.0 * np.pi, corners, endpoint=False)
    ring = np.stack([np.cos(angles), np.sin(angles), np.zeros(corners)], axis=1)
    return np.concatenate([ring, ring + np.eye(3)[2]]) @ kinseek.pose([0, 0, 0], rpy=[0.3, 0.2, 0.1])[:3, :3]


@pytest.mark.slow
def test_a_hull_with_a_side_of_too_many_corners_is_refused() -> None:
    """Nothing interrupts Qhull, whose time grows with the square of their number."""
    assert len(mesh_of(circles(500), hull=True).geometry().points()) == 1000
    with pytest.raises(
        InvalidScene, match=r"a flat side of its convex hull has 1,600 corners, .* at most 1,500"
    ):
        mesh_of(circles(1600), hull=True).geometry()


def test_a_cloud_of_too_many_points_is_refused() -> None:
    with pytest.raises(InvalidScene, match=r"at most 1,000,000 points, got 1,000,001"):
        Points(np.zeros((1_000_001, 3)), 0.01)


@pytest.mark.slow
def test_points_inside_do_not_count_as_corners() -> None:
    rng = np.random.default_rng(1)
    outer = scattered(2000) * [1, 1e-3, 50]
    points = np.concatenate([rng.uniform(-0.5, 0.5, (100_000, 3)) * [1, 1e-3, 50], outer])
    left = outermost(points)
    assert len(left) <= MOST_CORNERS
    assert {tuple(row) for row in outer} <= {tuple(row) for row in left}
    assert {tuple(row) for row in mesh_of(points, hull=True).corners} == {tuple(row) for row in outer}
    assert (outermost(points[:100]) == points[:100]).all()


@pytest.mark.slow
def test_the_inner_side_of_a_thin_wall_has_no_corners_of_the_hull() -> None:
    """A hollow sphere with a wall of 3 % was refused: the first directions cut deeper than that."""
    outer = scattered(10_000)
    outer /= np.linalg.norm(outer, axis=1)[:, None]
    left = outermost(np.concatenate([outer, 0.97 * outer]))
    assert len(left) < MOST_CORNERS
    assert {tuple(row) for row in outer} <= {tuple(row) for row in left}


@pytest.mark.slow
def test_the_search_for_corners_ends_in_seconds() -> None:
    """Points on spheres in each other, such that each step helps a little, took minutes."""
    rng, radius = np.random.default_rng(0), np.ones(300_000)
    for share, size in ((0.39, 0.994), (0.30, 0.978), (0.21, 0.93), (0.115, 0.7)):
        radius[: int(share * len(radius))] = size
    points = rng.normal(size=(len(radius), 3))
    points *= (radius / np.linalg.norm(points, axis=1))[:, None]
    began = time.process_time()
    assert len(outermost(points)) > MOST_CORNERS
    assert time.process_time() - began < 10


@pytest.mark.slow
def test_depths_below_many_planes_take_little_memory() -> None:
    """All products at once took 7 GB for a hull of a 1 MB file."""
    rng = np.random.default_rng(2)
    points, planes = rng.normal(size=(3200, 3)), rng.normal(size=(4, 20_000))
    tracemalloc.start()
    found = farthest_beyond(points, planes)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400e6
    some = planes[:, ::100]
    assert (farthest_beyond(points, some) == (points @ some[:3] + some[3]).max(axis=1)).all()
    assert (found >= farthest_beyond(points, some) - 1e-12).all()
    assert found[0] == pytest.approx((points[0] @ planes[:3] + planes[3]).max(), abs=1e-12)


CORNERS = np.array(list(itertools.product((0.0, 1.0), repeat=3)))


@pytest.mark.parametrize(
    ("vertices", "faces", "why"),
    [
        (CORNERS, np.arange(24).reshape(6, 4) % 8, r"got \(8, 3\) and \(6, 4\)"),
        (np.ones((6, 4)), [[0, 1, 2]], r"got \(6, 4\) and \(1, 3\)"),
        (np.ones((6, 2)), [[0, 1, 2]], r"got \(6, 2\) and \(1, 3\)"),
        (CORNERS, [0, 1, 2], r"got \(8, 3\) and \(3,\)"),
        (CORNERS, np.ones((4, 0)), r"got \(8, 3\) and \(4, 0\)"),
        (CORNERS, [[0.9, 1, 2]], "a face refers to a vertex that does not exist"),
        (CORNERS, [[np.inf, 1, 2]], "a face refers to a vertex that does not exist"),
    ],
)
def test_arrays_of_another_shape_make_no_mesh(vertices: Any, faces: Any, why: str) -> None:
    """Squares, and vertices of four numbers, were cut into rows of three."""
    with pytest.raises(InvalidScene, match=why):
        Mesh(vertices, faces)


@pytest.mark.parametrize("scale", [(1, 2), "a", "2", True, [[1, 1, 1]], 1j, np.nan, 0])
def test_a_scale_is_one_number_or_three(scale: Any, tmp_path: Path) -> None:
    trimesh.creation.box((1, 1, 1)).export(tmp_path / "a.stl")
    with pytest.raises(InvalidScene, match="scale must be one number or three, other than 0"):
        Mesh.read(tmp_path / "a.stl", scale)


@pytest.mark.parametrize(
    "flat", [[0, 0, 1], [3, 3, 3], [8, 0, 1]], ids=["a line", "a point", "three in line"]
)
def test_triangles_without_area_change_no_distance(flat: list[int]) -> None:
    """coal took spheres metres away from a line as touching it."""
    coal = pytest.importorskip("coal")
    box = trimesh.creation.box(bounds=([0, 0, 0], [1, 1, 1]))
    corners = np.array(box.vertices)
    vertices = np.concatenate([corners, corners[:2].mean(axis=0, keepdims=True)])
    mesh, sphere = Mesh(vertices, np.concatenate([box.faces, [flat]]), hull=False), coal.Sphere(0.05)
    for place in np.random.default_rng(0).uniform(-2.0, 3.0, (200, 3)):
        off = np.linalg.norm(place - np.clip(place, 0.0, 1.0)) - 0.05
        if off > 0.0:
            distance = coal.distance(
                mesh.geometry(),
                coal.Transform3s(),
                sphere,
                coal.Transform3s(np.eye(3), place),
                coal.DistanceRequest(),
                coal.DistanceResult(),
            )
            assert distance == pytest.approx(off, abs=2e-7)
