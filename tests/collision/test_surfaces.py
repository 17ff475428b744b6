"""Surfaces of bodies: closed, seen from outside, where the bodies are; and which bodies are hit."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kinseek

pytest.importorskip("coal")
trimesh = pytest.importorskip("trimesh")

from kinseek.collision import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere, Voxels  # noqa: E402
from kinseek.collision.bodies import Part  # noqa: E402
from kinseek.collision.surfaces import MOST_POINTS, bodies_hit, drawn_bodies, surface_of  # noqa: E402

RING = trimesh.creation.torus(1.0, 0.3)
PLACE = kinseek.pose([1.0, -2.0, 0.5], rpy=[0.3, -0.7, 2.0])
BALL = 4.0 / 3.0 * np.pi * 0.5**3
SHAPES: list[tuple[Shape, float]] = [
    (Box([1.0, 2.0, 3.0]), 6.0),
    (Sphere(0.5), BALL),
    (Cylinder(0.5, 2.0), np.pi * 0.5),
    (Capsule(0.5, 2.0), np.pi * 0.5 + BALL),
    (Mesh(RING.vertices, RING.faces, hull=False), RING.volume),
    (Mesh(RING.vertices, RING.faces, hull=True), RING.convex_hull.volume),
]


@pytest.mark.parametrize(("shape", "volume"), SHAPES, ids=lambda each: type(each).__name__)
def test_a_surface_encloses_the_volume_of_its_shape(shape: Shape, volume: float) -> None:
    surface = surface_of([Part(shape, PLACE)], 10_000)
    corners = surface.vertices[surface.faces]
    signed = np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6.0
    assert volume * 0.96 < signed < volume * (1.0 + 1e-6)
    assert surface.whole
    # Every edge is that of two triangles.
    edges = np.sort(np.concatenate([surface.faces[:, [i, (i + 1) % 3]] for i in range(3)]), axis=1)
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}
    back = (surface.vertices - PLACE[:3, 3]) @ PLACE[:3, :3]
    outside = np.linalg.norm(back, axis=1).max() if isinstance(shape, Sphere) else 0.0
    assert outside == pytest.approx(0.5 if isinstance(shape, Sphere) else 0.0)
    # Nothing sticks out of the shape: the hull of its corners, made thicker.
    low, high = shape.corners.min(axis=0), shape.corners.max(axis=0)
    assert (back >= low - shape.thickness - 1e-9).all()
    assert (back <= high + shape.thickness + 1e-9).all()


def test_a_mesh_with_too_many_triangles_is_a_box_around_it() -> None:
    ring = Mesh(RING.vertices, RING.faces, hull=False)
    surface = surface_of([Part(Box([1.0, 1.0, 1.0]), np.eye(4)), Part(ring, PLACE)], 100)
    assert len(surface.faces) == 24
    assert not surface.whole
    back = (surface.vertices[8:] - PLACE[:3, 3]) @ PLACE[:3, :3]
    np.testing.assert_allclose(
        [back.min(axis=0), back.max(axis=0)], [RING.vertices.min(axis=0), RING.vertices.max(axis=0)]
    )


def test_clouds_are_points_and_large_ones_are_thinned() -> None:
    cloud = np.random.default_rng(0).uniform(0.0, 1.0, (3 * MOST_POINTS, 3))
    surface = surface_of([Part(Points(cloud, 0.02), PLACE)], 0)
    assert 0.5 * MOST_POINTS < len(surface.points) <= MOST_POINTS
    assert surface.size == 0.04
    assert not len(surface.faces)
    few = surface_of([Part(Voxels(np.ones((2, 1, 1), dtype=bool), 0.1), PLACE)], 0)
    np.testing.assert_allclose((few.points - PLACE[:3, 3]) @ PLACE[:3, :3], [[0.05] * 3, [0.15, 0.05, 0.05]])
    assert few.size == pytest.approx(0.1)


def test_bodies_are_where_the_scene_has_them(tmp_path: Path) -> None:
    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.04)
    scene.add_box("table", (1.0, 1.0, 0.1), PLACE)
    file = tmp_path / "two.scene"
    one = "box\n0.1 0.2 0.3\n{} 0 0\n0 0 0 1\n0 0 0 0\n"
    file.write_text(
        f"two\n* pair\n0 0 1\n0 0 0 1\n2\n{one.format(0.5)}{one.format(0.9)}0\n.\n", encoding="utf-8"
    )
    scene.add_file(file)
    scene.attach("part", Sphere(0.02), to="tool0", pose=kinseek.pose([0.0, 0.0, 0.1]))
    other = kinseek.Scene.of(arm, capsules=0.04)
    scene.add_arm("other", other, np.zeros(6), kinseek.pose([2.0, 0.0, 0.0]))
    q = np.array([0.3, -1.2, 1.4, -0.5, 0.7, 0.1])
    drawn = {body.name: body for body in drawn_bodies(scene)}
    assert tuple(drawn) == scene.bodies
    assert {name for name, body in drawn.items() if body.alone} == {"table", "pair"}
    assert {name for name, body in drawn.items() if body.is_link} == set(
        kinseek.Scene.of(arm, capsules=0.04).bodies
    )
    np.testing.assert_allclose(drawn["table"].at(arm.chain, q), PLACE)
    np.testing.assert_allclose(
        drawn["part"].at(arm.chain, q), arm.fk(q) @ kinseek.pose([0.0, 0.0, 0.1]), atol=1e-12
    )
    np.testing.assert_allclose(drawn["pair"].at(arm.chain, q)[:3, 3], [0.5, 0.0, 1.0])
    np.testing.assert_allclose(drawn["pair"].parts[1].pose[:3, 3], [0.4, 0.0, 0.0])


def test_what_is_hit_is_named() -> None:
    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.04)
    q = np.array([0.3, -1.2, 1.4, -0.5, 0.7, 0.1])
    scene.add_sphere("ball", 0.05, arm.fk(q) @ kinseek.pose([0.0, 0.0, 0.3]))
    scene.add_sphere("near", 0.05, arm.fk(q) @ kinseek.pose([0.0, 0.0, 0.07]))
    assert bodies_hit(scene, np.array([q])) == {"near", "wrist_2_link"}
    assert bodies_hit(scene, np.array([q + 0.7])) == set()
    assert "ball" in bodies_hit(scene, np.array([q + 0.7, q]), 0.3)
