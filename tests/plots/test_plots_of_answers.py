"""Pictures of arms, landscapes, proofs, workspaces and paths show what kinseek says, and misuse is explained."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import plots
from kinseek.errors import InvalidUse, MissingExtra
from kinseek.robots.chain import joint_points
from legible import faults

pytestmark = pytest.mark.slow

matplotlib = pytest.importorskip("matplotlib")

PLANAR, UR5E, PANDA = (kinseek.load(name) for name in ("planar2", "ur5e", "panda"))
DOWN = kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0.0, 0.0])
FAR = kinseek.pose([0.9, 0.2, 0.5], rpy=[np.pi, 0.0, 0.0])
POINT = kinseek.Goal.position(PLANAR.fk([2.0, 1.1])[:3, 3])


def lines_of(axes: Any) -> list[Any]:
    """Points of every line in space, (k, 3) each."""
    return [np.array(line.get_data_3d()).T for line in axes.lines]


def test_branches_are_lines_from_base_to_goal() -> None:
    branches = UR5E.branches(DOWN)
    axes = plots.branches(branches, chosen=2).axes[0]
    arms = [line for line in lines_of(axes) if len(line) > 2]
    assert len(arms) == len(branches)
    for line in arms:
        np.testing.assert_allclose(line[-1], DOWN[:3, 3], atol=1e-6)
    bold = max(axes.lines, key=lambda line: line.get_linewidth())
    drawn = np.array(bold.get_data_3d()).T
    np.testing.assert_allclose(drawn, joint_points(UR5E.chain, branches.q[2]))
    frame = [line for line in lines_of(axes) if len(line) == 2]
    directions = np.array([(line[1] - line[0]) / np.linalg.norm(line[1] - line[0]) for line in frame])
    np.testing.assert_allclose(directions.T, DOWN[:3, :3], atol=1e-9)


def test_proportions_are_true() -> None:
    axes = plots.arm(PANDA, np.zeros(7)).axes[0]
    sides = np.ptp([axes.get_xlim(), axes.get_ylim(), axes.get_zlim()], axis=1)
    drawn = np.asarray(axes._box_aspect)
    np.testing.assert_allclose(drawn / drawn.max(), sides / sides.max(), rtol=1e-9)


def cell() -> kinseek.Scene:
    pytest.importorskip("coal")
    scene = kinseek.Scene.of(UR5E, capsules=0.05)
    scene.add_box("wall", (0.5, 0.05, 0.5), kinseek.pose([0.55, 0.0, 0.25]))
    scene.add_sphere("ball", 0.1, kinseek.pose([-0.5, 0.5, 0.2]))
    scene.add_points("cloud", np.full((5, 3), -0.5), 0.01)
    scene.attach(
        "part", kinseek.collision.Box((0.05, 0.05, 0.05)), to="tool0", pose=kinseek.pose([0, 0, 0.1])
    )
    return scene


def surfaces_of(axes: Any, colour: str) -> list[Any]:
    """Corners of the triangles of each surface of a colour in space, (k, 3) each."""
    rgb = matplotlib.colors.to_rgb(colour)
    found = [each for each in axes.collections if type(each).__name__ == "Poly3DCollection"]
    found = [each for each in found if np.allclose(each.get_facecolor()[0, :3], rgb)]
    # Matplotlib keeps them as a private array, whose name has changed.
    return [
        np.asarray(each._faces).reshape(-1, 3) if hasattr(each, "_faces") else each._vec[:3].T
        for each in found
    ]


SIDE, OTHER = kinseek.pose([[0.45, -0.3, 0.35], [0.45, 0.3, 0.35]], rpy=[np.pi, 0.0, 0.0])
INSIDE = kinseek.pose([0.45, 0.0, 0.3], rpy=[np.pi, 0.0, 0.0])


def test_bodies_are_drawn_and_red_is_what_is_hit() -> None:
    scene = cell()
    q = UR5E.ik(SIDE, scene=scene).require().q
    axes = plots.arm(UR5E, q, scene=scene).axes[0]
    assert surfaces_of(axes, plots.COLOURS[1]) == []
    wall, ball, part = surfaces_of(axes, "0.5")  # The arm is drawn as a line.
    np.testing.assert_allclose([wall.min(axis=0), wall.max(axis=0)], [[0.3, -0.025, 0.0], [0.8, 0.025, 0.5]])
    assert np.linalg.norm(ball - [-0.5, 0.5, 0.2], axis=1) == pytest.approx(0.1)
    np.testing.assert_allclose(part.mean(axis=0), (UR5E.fk(q) @ [0, 0, 0.1, 1])[:3], atol=1e-9)
    clouds = [each for each in axes.collections if len(each.get_offsets()) == 5]
    assert clouds
    hit = UR5E.ik(INSIDE).q
    axes = plots.arm(UR5E, [q, hit], scene=scene).axes[0]
    from kinseek.collision.surfaces import bodies_hit

    expected = bodies_hit(scene, hit[None])
    assert {"wall", "part"} <= expected
    assert "ball" not in expected
    assert len(surfaces_of(axes, plots.COLOURS[1])) == len(expected)
    assert len(surfaces_of(axes, "0.5")) == 2  # The ball, and the part at q.


def test_the_way_of_a_motion_is_a_curve_that_is_red_where_it_hits() -> None:
    scene = cell()
    q0 = UR5E.ik(SIDE, scene=scene).require().q
    path = scene.plan(q0, OTHER)
    assert path.success
    axes = plots.arm(UR5E, path).axes[0]
    curve = lines_of(axes)[0]
    np.testing.assert_allclose(curve, UR5E.fk(path.q)[:, :3, 3], atol=1e-12)
    bold = max(axes.lines, key=lambda line: line.get_linewidth())
    np.testing.assert_allclose(np.array(bold.get_data_3d()).T[-1], OTHER[:3, 3], atol=1e-5)
    assert len(surfaces_of(axes, "0.5")) > 4  # The part is drawn at each posture.
    assert surfaces_of(axes, plots.COLOURS[1]) == []
    assert not [line for line in axes.lines if line.get_color() == plots.COLOURS[1]]
    sweep = q0 + np.linspace(0.0, 1.2, 40)[:, None] * [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    motion = UR5E.follow(UR5E.fk(sweep), start=q0).timed(acceleration=5.0)
    axes = plots.arm(UR5E, motion, scene=scene).axes[0]
    red = [np.array(line.get_data_3d()).T for line in axes.lines if line.get_color() == plots.COLOURS[1]]
    q = motion.q(np.linspace(0.0, motion.duration, plots.scenes.MOMENTS))
    np.testing.assert_allclose(np.concatenate(red), UR5E.fk(q)[~scene.free(q)][:, :3, 3], atol=1e-12)
    assert len(surfaces_of(axes, plots.COLOURS[1])) >= 1
    without = plots.arm(UR5E, motion).axes[0]
    assert surfaces_of(without, "0.5") == []


def test_the_curve_of_a_broken_path_is_broken() -> None:
    fence = cell()
    q0, q1 = UR5E.ik(SIDE, scene=fence).require().q, UR5E.ik(OTHER, scene=fence).require().q
    rows = np.array([q0, q0 + 0.01, q1, q1 + 0.01])
    path = UR5E.follow(UR5E.fk(rows[[0, 1]]), start=q0)
    broken = dataclasses.replace(path, q=rows, breaks=np.array([1]))
    parts = [part.tolist() for part in plots.scenes.rows_of(broken)[2]]
    assert parts == [[0, 1], [2, 3]]


def test_edges_are_drawn_where_a_surface_is_bent() -> None:
    pytest.importorskip("coal")
    from kinseek.collision import Box, Capsule, Cylinder
    from kinseek.collision.bodies import Part
    from kinseek.collision.surfaces import SIDES, surface_of

    for shape, count in ((Box([1, 2, 3]), 12), (Cylinder(0.5, 2.0), 2 * SIDES), (Capsule(0.5, 2.0), 0)):
        surface = surface_of([Part(shape, np.eye(4))], 0)
        assert len(plots.scenes._creases(surface)) == count


def test_a_landscape_is_lowest_where_the_answers_are() -> None:
    answers = PLANAR.branches(POINT).q
    assert len(answers) == 2
    axes = plots.landscape(PLANAR.ik(POINT), solutions=answers, points=181).axes[0]
    mesh = axes.collections[0]
    errors = np.asarray(mesh.get_array()).reshape(181, 181)
    values = np.linspace(0, 2 * np.pi, 181)
    for q in answers:
        column, row = (int(np.argmin(np.abs(values - each))) for each in q)
        assert errors[row, column] < np.percentile(errors, 0.5)
    marked = axes.lines[0].get_xydata()
    np.testing.assert_array_equal(marked, answers)


def test_passes_show_every_node_and_the_next_window() -> None:
    solution = PLANAR.ik(PLANAR.fk([2.0, 1.1]), solver=kinseek.DivideAndConquer(breadth=2), trace=True)
    panels = plots.passes(solution, first=4).axes[:4]
    for i, (panel, each) in enumerate(zip(panels, solution.trace, strict=False)):
        nodes = panel.collections[-1]
        assert len(nodes.get_offsets()) == np.prod(each.counts)
        best = nodes.get_offsets()[np.argmin(nodes.get_array())]
        np.testing.assert_allclose(best, each.q, atol=1e-9)
        assert nodes.get_array().min() == pytest.approx(np.log10(each.weighted_error))
        following = solution.trace[i + 1]
        corners = [patch.get_xy() for patch in panel.patches]
        turned = [following.lower + 2 * np.pi * np.array([k, m]) for k in (-1, 0, 1) for m in (-1, 0, 1)]
        assert any(np.allclose(a, b) for a in corners for b in turned)


def test_the_boxes_are_those_of_the_proof() -> None:
    for arm, goal in ((UR5E, FAR), (PLANAR, kinseek.Goal.position([0.5, 0.4, 0.02]))):
        certificate = arm.prove(goal)
        assert certificate.verdict is kinseek.Verdict.UNREACHABLE
        assert certificate.boxes > 5
        looks = plots.proofs.examined_boxes(certificate.problem, 10_000)
        assert len(looks) == certificate.boxes
        title = plots.boxes(certificate).axes[0].get_title()
        assert f"{certificate.boxes:,} boxes" in title
        assert "0 left" in title


def test_no_answer_is_in_a_box_that_is_proved_empty() -> None:
    arm = UR5E.with_locked(dict.fromkeys(UR5E.joint_names[3:], 0.3))
    q = arm.sample(1, seed=3)[0]
    certificate = arm.prove(kinseek.Goal.position(arm.fk(q)[:3, 3]))
    looks = plots.proofs.examined_boxes(certificate.problem, 400)
    k = len(looks[0].box) // 2
    held = np.mod(q[:k] - looks[0].box[:k] + np.pi, 2 * np.pi) - np.pi + looks[0].box[:k]
    for box, left in looks:
        assert k == arm.dof
        if (np.abs(held - box[:k]) <= box[k:]).all():
            assert any((np.abs(held - each[:k]) <= each[k:] + 1e-9).all() for each in left)
    assert " 0 left" not in plots.boxes(certificate, most=400).axes[0].get_title()


def test_a_budget_leaves_boxes() -> None:
    certificate = UR5E.prove(FAR)
    title = plots.boxes(certificate, (1, 2), most=30).axes[0].get_title()
    assert title.startswith("30 boxes")
    assert ", 0 left" not in title


def test_the_workspace_of_a_planar_arm_is_a_ring() -> None:
    links = np.linalg.norm(PLANAR.chain.fixed[1:, :, 3], axis=1)
    axes = plots.workspace(PLANAR, POINT, plane="xy", cells=20, width=2.4 * links.sum(), budget=200).axes[0]
    verdict = np.asarray(axes.images[0].get_array())
    left, right, *_ = axes.images[0].get_extent()
    middles = left + (np.arange(20) + 0.5) / 20 * (right - left)
    r = np.hypot(middles, middles[:, None])
    inside = (r <= links.sum()) & (r >= abs(links[0] - links[1]))
    np.testing.assert_array_equal(verdict, np.where(inside, 0, 1))


def test_a_workspace_lies_in_the_plane_of_the_arm() -> None:
    axes = plots.workspace(PLANAR, POINT, cells=6, budget=0).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "y [m]")
    upright = kinseek.pose([0.0, 0.0, 0.0], rpy=[np.pi / 2, 0.0, 0.0])
    goal = kinseek.Goal.position([0.3, 0.0, 0.4], base=upright)
    axes = plots.workspace(PLANAR, goal, cells=6, budget=0).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "z [m]")
    axes = plots.workspace(UR5E, DOWN, cells=6, budget=0).axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("x [m]", "z [m]")


def test_the_workspace_of_an_arm_on_a_table_lies_around_the_table() -> None:
    table = kinseek.pose([5.0, 0.0, 1.0])
    there = plots.workspace(UR5E, kinseek.Goal.pose(table @ DOWN, base=table), cells=10, budget=0).axes[0]
    here = plots.workspace(UR5E, DOWN, cells=10, budget=0).axes[0]
    np.testing.assert_array_equal(there.images[0].get_array(), here.images[0].get_array())
    np.testing.assert_allclose(np.subtract(there.get_xlim(), here.get_xlim()), 5.0)


def test_without_proofs_what_is_not_reached_is_open() -> None:
    axes = plots.workspace(UR5E, DOWN, cells=8, budget=0).axes[0]
    assert set(np.unique(axes.images[0].get_array())) == {0, 2}


def test_joints_stand_between_their_limits_and_the_largest_step_is_told() -> None:
    q = np.linspace(PANDA.lower * 0.5, PANDA.upper * 0.5, 30)
    q[12:, 3] -= 0.25  # The largest step leads to row 12.
    figure = plots.joints(q, PANDA)
    assert f"{abs(q[12, 3] - q[11, 3]):.3g} rad of panda_joint4 to row 12" in figure.get_suptitle()
    for i, axes in enumerate(figure.axes):
        levels = sorted(line.get_ydata()[0] for line in axes.lines if line.get_linestyle() == "--")
        assert levels == [PANDA.lower[i], PANDA.upper[i]]
        np.testing.assert_array_equal(axes.lines[0].get_ydata(), q[:, i])


def test_a_break_is_no_step_and_breaks_the_lines() -> None:
    q = np.zeros((20, 7))
    q[8:, 2], q[15:, 5] = 1.0, 0.25
    figure = plots.joints(q, PANDA, breaks=[8], times=np.arange(20) * 0.5)
    assert "0.25 rad of panda_joint6 to row 15" in figure.get_suptitle()
    assert [len(line.get_xdata()) for line in figure.axes[0].lines[:2]] == [8, 12]
    dotted = [line.get_xdata()[0] for line in figure.axes[0].lines if line.get_linestyle() == ":"]
    assert dotted == [3.75]


def test_lengths_and_angles_have_a_largest_step_each() -> None:
    arm = kinseek.load("cylindrical3")
    figure = plots.joints([[0.0, 0.1, 0.3], [0.5, 0.3, 0.3]], arm)
    assert "0.5 rad of turn to row 1 and 0.2 m of lift to row 1" in figure.get_suptitle()


def circle(arm: kinseek.Arm, **limits: Any) -> kinseek.Trajectory:
    """A motion of the hand along a circle."""
    angle = np.linspace(0.0, 2.0 * np.pi, 100)
    poses = np.repeat(DOWN[None], 100, axis=0)
    poses[:, :2, 3] += 0.1 * np.stack([np.cos(angle) - 1.0, np.sin(angle)], axis=1)
    return arm.follow(poses).timed(acceleration=6.0, **limits)


def test_a_trajectory_is_drawn_as_shares_of_its_limits() -> None:
    motion = circle(PANDA, tool_speed=0.3)
    figure = plots.trajectory(motion)
    panels = {axes.get_ylabel().replace("\n", " "): axes for axes in figure.axes}
    assert list(panels) == ["joint / limit", "velocity / limit", "acceleration / limit", "tip [m/s]"]
    drawn = [line.get_data() for line in panels["velocity / limit"].lines[:7]]
    for i, (t, share) in enumerate(drawn):
        np.testing.assert_allclose(share, motion.velocity(t)[:, i] / PANDA.velocity[i])
    t, speed = panels["tip [m/s]"].lines[0].get_data()
    np.testing.assert_allclose(speed, motion.tip_speed(t))
    limits = [line.get_ydata()[0] for line in panels["tip [m/s]"].lines if line.get_linestyle() == "--"]
    assert limits == [0.3]
    # Thick is where the tool has its full speed, and this is in the title.
    thick = [line for line in panels["tip [m/s]"].lines if line.get_linewidth() > 2.0]
    assert len(thick) == 1
    marked = np.isfinite(thick[0].get_ydata())
    np.testing.assert_array_equal(
        marked,
        np.any([(t >= cap.begin) & (t <= cap.end) for cap in motion.bottleneck if cap.joint is None], axis=0),
    )
    assert speed[marked].min() > 0.29
    assert f"tool speed {100 * marked.mean():.0f} %" in figure.get_suptitle()
    legend = [text.get_text() for text in figure.legends[0].get_texts()]
    assert legend == list(PANDA.joint_names)


def test_stops_of_a_trajectory_are_dotted() -> None:
    q = np.array([[0.1, -1.0, 1.2, -0.4, 0.5, 0.0]]) + np.linspace(0.0, 0.5, 20)[:, None]
    path = UR5E.follow(UR5E.fk(np.concatenate([q, q[:10] + 1.5])), max_step=0.2)
    motion = path.timed(acceleration=6.0)
    assert len(motion.stops) > 0
    dotted = [
        line.get_xdata()[0] for line in plots.trajectory(motion).axes[1].lines if line.get_linestyle() == ":"
    ]
    assert dotted == motion.pose_times[motion.stops].tolist()


@pytest.mark.parametrize("arm", [UR5E, PANDA], ids=lambda arm: arm.name)
def test_samples_have_the_coordinates_they_are_sorted_by(arm: kinseek.Arm) -> None:
    from kinseek.kernels.atlas.tree import LEAF_SIZE
    from kinseek.kinds import POSE
    from kinseek.plots.atlases import coordinates, leaf_of
    from kinseek.robots.geometry import divide
    from kinseek.solvers.atlas.index import atlas_of

    index = atlas_of(arm.chain)
    tree = index.sorted.tree
    kept = tree.points.transpose(0, 2, 1).reshape(index.samples, -1)
    np.testing.assert_allclose(coordinates(index.sorted.poses, divide(arm.chain, POSE)), kept, atol=1e-12)
    found = np.array([leaf_of(tree, point) for point in kept[::50]])
    # But for those that equal where the tree is split.
    assert (found == np.arange(index.samples)[::50] // LEAF_SIZE).mean() > 0.98


def test_the_leaves_beside_that_of_a_pose_are_drawn() -> None:
    from kinseek.kernels.atlas.tree import BESIDE, LEAF_SIZE

    near = (BESIDE - 1) * LEAF_SIZE
    for pose in UR5E.fk(np.random.default_rng(1).uniform(UR5E.lower, UR5E.upper, (3, 6))):
        texts = [text.get_text() for text in plots.samples(UR5E, pose).legends[0].get_texts()]
        assert texts[:2] == [
            f"{near} samples of the leaves beside it",
            f"{LEAF_SIZE} samples of the pose's leaf",
        ]


def test_axes_of_ones_own_are_drawn_on() -> None:
    figure, (left, right) = plots.plane(2)
    solution = PLANAR.ik(POINT)
    assert plots.landscape(solution, ax=left, points=11) is figure
    assert plots.boxes(UR5E.prove(FAR), ax=right) is figure
    assert len(figure.axes) == 2
    figure, axes = plots.space()
    assert plots.arm(PANDA, np.zeros(7), ax=axes) is figure
    with pytest.raises(InvalidUse, match=r"axes in space.*got axes in a plane"):
        plots.arm(PANDA, np.zeros(7), ax=left)
    with pytest.raises(InvalidUse, match="axes in a plane, got axes in space"):
        plots.landscape(solution, ax=axes)
    with pytest.raises(InvalidUse, match="got Figure"):
        plots.landscape(solution, ax=figure)


def test_margins_are_cut_and_a_long_title_fits() -> None:
    arm = kinseek.load("scara4")
    figure, axes = plots.space()
    plots.draw_arm(axes, arm, np.zeros(4))
    plots.same_scale(axes)
    before = figure.get_size_inches().copy()
    plots.trim(
        figure, axes, "A long title, longer than a picture of a small arm whose margins are cut is wide"
    )
    assert figure.get_size_inches()[1] < 0.8 * before[1]
    assert faults(figure) == []
    with pytest.raises(InvalidUse, match="axes in space"):
        plots.trim(*plots.plane())


def test_settings_stay_as_they_are() -> None:
    before = dict(matplotlib.rcParams)
    plots.passes(PLANAR.ik(POINT, solver=kinseek.DivideAndConquer(), trace=True), points=11)
    plots.branches(UR5E.branches(DOWN))
    assert dict(matplotlib.rcParams) == before


def narrow(name: str) -> Any:
    """An arm whose picture has a short side."""
    arm = kinseek.load(name)
    target = kinseek.Goal.pose(arm.fk(arm.sample(1, seed=4)[0]))
    found = arm.branches(target)
    assert isinstance(found, kinseek.Branches)
    return plots.branches(found)


PICTURES: dict[str, Callable[[], Any]] = {
    "branches": lambda: plots.branches(UR5E.branches(DOWN)),
    "redundant": lambda: plots.branches(PANDA.branches(DOWN), view=(15, -40)),
    "arm": lambda: plots.arm(UR5E, UR5E.ik(FAR).q, goal=FAR),
    "scene": lambda: plots.arm(UR5E, UR5E.ik(INSIDE).q, goal=INSIDE, scene=cell()),
    "plan": lambda: plots.arm(UR5E, cell().plan(UR5E.ik(SIDE, scene=cell()).q, OTHER)),
    "position": lambda: plots.arm(PLANAR, [2.0, 1.1], goal=POINT),
    "landscape": lambda: plots.landscape(PLANAR.ik(POINT), points=31),
    "part": lambda: plots.landscape(PLANAR.ik(POINT), within=[(1, 3), (0, 2)], points=31),
    "passes": lambda: plots.passes(
        UR5E.ik(DOWN, solver=kinseek.DivideAndConquer(breadth=2), trace=True), (1, 2), points=11
    ),
    "passes of some joints each": lambda: plots.passes(
        UR5E.ik(DOWN, solver=kinseek.SeparateChains(), trace=True), (1, 2), points=11
    ),
    "boxes": lambda: plots.boxes(UR5E.prove(FAR)),
    "workspace": lambda: plots.workspace(UR5E, DOWN, cells=6, budget=100),
    "samples": lambda: plots.samples(UR5E, DOWN),
    "few samples": lambda: plots.samples(PLANAR, PLANAR.fk([2.0, 1.1])),
    "narrow": lambda: narrow("jaco2_6"),
    "flat": lambda: narrow("m430ia2f"),
    "joints": lambda: plots.joints(np.linspace(UR5E.lower, UR5E.upper, 9), UR5E, breaks=[4]),
    "joints that slide": lambda: plots.joints(
        kinseek.load("scara4").sample(300), kinseek.load("scara4"), times=np.arange(300) * 0.01
    ),
    "trajectory": lambda: plots.trajectory(circle(UR5E)),
    "trajectory of a tool": lambda: plots.trajectory(circle(PANDA, tool_speed=0.3)),
}


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_can_be_read(name: str) -> None:
    assert faults(PICTURES[name]()) == []


@pytest.mark.parametrize("name", PICTURES)
def test_without_matplotlib_the_extra_is_named(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(MissingExtra, match=r"kinseek\[plot\]"):
        PICTURES[name]()


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda: plots.arm(PANDA, np.zeros((0, 7))), "nothing to draw"),
        (lambda: plots.arm(PANDA, np.zeros((1, 2, 7))), r"\(7,\) or \(k, 7\), got \(1, 2, 7\)"),
        (lambda: plots.arm(PANDA, np.zeros(6)), r"q must have shape \(7,\)"),
        (lambda: plots.arm(PANDA, np.zeros(7), goal=[DOWN, DOWN]), "batch of shape"),
        (lambda: plots.arm(PANDA, np.zeros(7), scene=3), "scene must be a kinseek.Scene, got int"),  # type: ignore[arg-type]
        (lambda: plots.arm(PANDA, np.zeros(7), scene=cell()), "this scene is of 'ur5e'"),
        (
            lambda: plots.arm(PANDA, UR5E.follow([DOWN])),
            "motion must be one of 'panda' .*, got one of 'ur5e'",
        ),
        (lambda: plots.branches(UR5E.branches(FAR)), "goal was not reached"),
        (lambda: plots.branches(UR5E.branches(DOWN), chosen=8), "from 0 to 7, got 8"),
        (lambda: plots.branches(UR5E.branches(DOWN), chosen=-1), "chosen must be a whole number"),
        (lambda: plots.branches(UR5E.branches([DOWN, DOWN])), "got BranchesBatch"),  # type: ignore[arg-type]
        (lambda: plots.landscape(PLANAR.ik(POINT), points=1), "points must be a whole number of at least 2"),
        (lambda: plots.landscape(PLANAR.ik(POINT), (0, 2)), "from 0 to 1"),
        (lambda: plots.landscape(PLANAR.ik(POINT), within=[(1, 0), (0, 1)]), "increasing values"),
        (lambda: plots.landscape(PLANAR), "got Arm"),  # type: ignore[arg-type]
        (lambda: plots.landscape(PLANAR.ik(PLANAR.fk([[2.0, 1.1]]))), "choose one"),
        (lambda: plots.landscape(PLANAR.ik(POINT), solutions=[[1.0, np.nan]]), "solutions contains NaN"),
        (lambda: plots.passes(PLANAR.ik(POINT)), "trace=True"),
        (lambda: plots.passes(PLANAR.ik(POINT, trace=True)), "has a window"),
        (
            lambda: plots.passes(
                PLANAR.ik(POINT, solver=kinseek.BruteForce(branching_factor=60), trace=True)
            ),
            "3,600 nodes",
        ),
        (lambda: plots.boxes(PLANAR.ik(POINT)), "expected a certificate of arm.prove, got Solution"),  # type: ignore[arg-type]
        (lambda: plots.boxes(UR5E.prove(kinseek.pose([3, 0, 0], rpy=[0, 0, 0]))), "there are no boxes"),
        (lambda: plots.boxes(UR5E.prove(FAR), ("elbow_joint", "wrist_3_joint")), "divided out"),
        (lambda: plots.boxes(PLANAR.prove(PLANAR.fk([2.0, 1.1]))), "joint 'joint1' alone"),
        (lambda: plots.boxes(UR5E.prove(FAR), most=0), "most must be a whole number of at least 1"),
        (lambda: plots.workspace(UR5E, DOWN, plane="xx"), "two of the axes"),
        (lambda: plots.workspace(UR5E, DOWN, width=-1), "positive length"),
        (lambda: plots.workspace(UR5E, [DOWN, DOWN]), "batch of shape"),
        (lambda: plots.workspace(UR5E, kinseek.Goal.pose(DOWN, free="z")), "cannot be drawn for"),
        (lambda: plots.samples(UR5E, [DOWN, DOWN]), "one pose is looked up"),
        (lambda: plots.samples(kinseek.load("cylindrical3"), DOWN), "'cylindrical3' is not such an arm"),
        (lambda: plots.joints(np.zeros((1, 7)), PANDA), "N of at least 2"),
        (lambda: plots.joints(np.zeros((3, 7)), PANDA, breaks=[3]), "from 1 to 2"),
        (lambda: plots.joints(np.zeros((3, 7)), PANDA, breaks=[0.5]), "from 1 to 2"),  # type: ignore[list-item]
        (lambda: plots.joints(np.zeros((3, 7)), PANDA, times=[0, 1, 1]), "3 increasing numbers"),
        (lambda: plots.trajectory(UR5E.follow([DOWN])), "got Path"),  # type: ignore[arg-type]
        (lambda: plots.trajectory(UR5E.follow([DOWN]).timed(acceleration=1.0)), "takes no time"),
    ],
)
def test_what_cannot_be_drawn_says_so(draw: Callable[[], Any], words: str) -> None:
    with pytest.raises(kinseek.KinseekError, match=words):
        draw()
