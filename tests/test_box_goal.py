"""Goals with free axes and ranges, of a tool, from another base: judged by SciPy, never by the kernels."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from benchmarks.targets import plain_fk, random_joints, singular_joints
from chains import poses
from kinseek import Goal
from kinseek.branches.result import Branches, BranchesBatch
from kinseek.errors import InvalidGoal, InvalidProblem
from kinseek.goal import Frame
from kinseek.kernels.arm.range_error import judge_ranges
from kinseek.problem import Problem
from kinseek.proof.branch_and_bound import prove
from kinseek.proof.certificate import Verdict
from kinseek.ranges import AXES
from kinseek.robots import catalog_entry, catalog_names
from kinseek.solution import Status, conclude
from kinseek.solvers.atlas.index import MOST_CACHED, atlas_of

Array = NDArray[np.float64]

ROUNDING = 1e-12


def deviation(T: Array, wanted: Array, frame: str) -> Array:
    """Six components of the deviation of poses, (k, 4, 4) -> (k, 6)."""
    R, G = T[:, :3, :3], wanted[:, :3, :3]
    back = np.swapaxes(G, 1, 2)
    moved = T[:, :3, 3] - wanted[:, :3, 3]
    if frame == "tool":
        moved = np.einsum("kij,kj->ki", back, moved)
    turned = back @ R if frame == "tool" else R @ back
    return np.hstack([moved, Rotation.from_matrix(turned).as_rotvec()])


def outside(deviations: Array, box: dict[str, tuple[float, float]], free: tuple[str, ...]) -> Array:
    """Lengths of what sticks out, position and orientation, (k, 2)."""
    gaps = np.zeros_like(deviations)
    for i, axis in enumerate(AXES):
        if axis in free:
            continue
        low, high = box.get(axis, (0.0, 0.0))
        gaps[:, i] = np.maximum(0.0, np.maximum(low - deviations[:, i], deviations[:, i] - high))
    return np.stack([np.linalg.norm(gaps[:, :3], axis=1), np.linalg.norm(gaps[:, 3:], axis=1)], axis=1)


CASES: dict[str, dict[str, Any]] = {
    "slide and turn": {"free": ("z", "rx", "ry"), "box": {}},
    "flat": {"free": ("x", "y"), "box": {"rx": (-0.1, 0.3)}},
    "box": {"free": (), "box": {"x": (-0.01, 0.01), "y": (0.0, 0.05), "rz": (-0.5, 0.5)}},
    "wide": {"free": (), "box": {"z": (-0.2, 0.2), "rx": (-2.0, 2.0), "rz": (-3.0, 1.0)}},
    "place": {"free": ("rx", "ry", "rz"), "box": {"z": (-math.inf, 0.1)}},
}


def away(case: dict[str, Any], count: int, seed: int) -> Array:
    """Deviations inside a case's ranges, (count, 6)."""
    rng = np.random.default_rng(seed)
    result = np.zeros((count, 6))
    for i, axis in enumerate(AXES):
        low, high = case["box"].get(axis, (-0.5, 0.5) if axis in case["free"] else (0.0, 0.0))
        result[:, i] = rng.uniform(max(low, -0.5), min(high, 0.5), count)
    return result


def targets_from(T: Array, deviations: Array, frame: str) -> Array:
    """Wanted poses from which poses T deviate by that much."""
    turn = Rotation.from_rotvec(deviations[:, 3:]).as_matrix()
    wanted = T.copy()
    back = np.swapaxes(turn, 1, 2)
    wanted[:, :3, :3] = T[:, :3, :3] @ back if frame == "tool" else back @ T[:, :3, :3]
    moved = deviations[:, :3]
    if frame == "tool":
        moved = np.einsum("kij,kj->ki", wanted[:, :3, :3], moved)
    wanted[:, :3, 3] -= moved
    return wanted


@pytest.mark.slow
@pytest.mark.parametrize("frame", ["tool", "base"])
@pytest.mark.parametrize("case", CASES.values(), ids=CASES.keys())
@pytest.mark.parametrize("name", ["ur5e", "so101", "scara4", "ur10e_rail"])
def test_reachable_goals_are_solved_and_judged_honestly(
    name: str, case: dict[str, Any], frame: Frame
) -> None:
    arm = kinseek.load(name)
    T = plain_fk(arm.chain, random_joints(arm.chain, 100, seed=5))
    wanted = targets_from(T, away(case, len(T), seed=6), frame)
    solution = arm.ik(Goal.pose(wanted, free=case["free"], box=case["box"], frame=frame))
    reached = plain_fk(arm.chain, solution.q)
    errors = outside(deviation(reached, wanted, frame), case["box"], case["free"])
    np.testing.assert_allclose(solution.position_error, errors[:, 0], atol=ROUNDING)
    np.testing.assert_allclose(solution.orientation_error, errors[:, 1], atol=ROUNDING)
    assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
    assert solution.success.all(), np.flatnonzero(~solution.success)
    assert (errors <= 1e-6 + ROUNDING).all()


@pytest.mark.parametrize("name", ["ur5e", "m430ia2f"])
def test_a_free_turn_in_the_base_is_judged_by_the_angle_of_its_axis(name: str) -> None:
    arm = kinseek.load(name)
    T = plain_fk(arm.chain, random_joints(arm.chain, 100, seed=7))
    wanted = targets_from(T, np.c_[np.zeros((100, 5)), np.linspace(-3, 3, 100)], "base")
    solution = arm.ik(Goal.pose(wanted, free="rz", frame="base"))
    reached = plain_fk(arm.chain, solution.q)
    turned = reached[:, :3, :3] @ np.swapaxes(wanted[:, :3, :3], 1, 2)
    angle = np.arctan2(np.hypot(turned[:, 0, 2], turned[:, 1, 2]), turned[:, 2, 2])
    np.testing.assert_allclose(solution.orientation_error, angle, atol=1e-9)
    assert solution.success.all()


def test_one_free_turn_of_the_tool_is_a_pointing_goal() -> None:
    arm = kinseek.load("ur5e")
    T = plain_fk(arm.chain, random_joints(arm.chain, 20, seed=8))
    goal = Goal.pose(T, free="rz")
    assert (goal.kind, goal.tool_axis) == ("pointing", (0.0, 0.0, 1.0))
    assert Goal.pose(T, box={"rx": (-math.pi, math.pi)}).tool_axis == (1.0, 0.0, 0.0)
    assert Goal.pose(T, free=("rx", "ry", "rz")).kind == "position"
    assert Goal.pose(T, box={"x": (0, 0)}).kind == "pose"
    np.testing.assert_array_equal(arm.ik(goal).q, arm.ik(Goal(T, kind="pointing")).q)


def test_position_and_pointing_with_ranges() -> None:
    arm = kinseek.load("panda")
    T = plain_fk(arm.chain, random_joints(arm.chain, 50, seed=9))
    near_it = T[:, :3, 3] + [0.0, 0.0, 0.05]
    solution = arm.ik(Goal.position(near_it, free="x", box={"z": (-0.1, 0.0)}))
    moved = plain_fk(arm.chain, solution.q)[:, :3, 3] - near_it
    assert solution.success.all()
    assert (np.abs(moved[:, 1]) <= 1.1e-6).all()
    assert ((moved[:, 2] >= -0.1 - 1.1e-6) & (moved[:, 2] <= 1.1e-6)).all()
    one = T[0]
    solution = arm.ik(Goal.pointing(one[:3, 3], one[:3, 1], [0, 1, 0], free=("x", "y", "z")))
    assert solution.success
    np.testing.assert_allclose(arm.fk(solution.q)[:3, 1], one[:3, 1], atol=2e-6)


END = st.floats(-1.0, 1.0)


@st.composite
def nested(draw: st.DrawFn) -> tuple[dict[str, Any], dict[str, Any]]:
    """A tight box and a looser one around it."""
    tight, loose, free = {}, {}, []
    for axis in draw(st.lists(st.sampled_from(AXES), min_size=1, max_size=5, unique=True)):
        low = draw(END)
        high = low + draw(st.floats(0.01, 1.0))
        tight[axis] = (low, high)
        if draw(st.booleans()):
            loose[axis] = (low - draw(st.floats(0.0, 1.0)), high + draw(st.floats(0.0, 1.0)))
        else:
            free.append(axis)
    return {"box": tight}, {"box": loose, "free": free}


@pytest.mark.slow
@settings(max_examples=60)
@given(poses(), nested(), st.sampled_from(["tool", "base"]))
def test_what_satisfies_the_tighter_goal_satisfies_the_looser(
    target: Array, boxes: tuple[dict[str, Any], dict[str, Any]], frame: Frame
) -> None:
    arm = kinseek.load("ur5e")
    tight, loose = (Goal.pose(target, frame=frame, **box) for box in boxes)
    q = arm.ik(tight, solver=kinseek.Atlas(samples=512)).q[None]
    if loose.kind != "box" or loose.swing is not None:
        return  # One free turn alone is judged by its axis, not by the rotation vector: tested by itself.
    one, other = (
        judge_ranges(kinseek.Problem(arm.chain, goal).arrays, q, goal.questions, 1.0, 1.0)[0]
        for goal in (tight, loose)
    )
    assert (other[:2] <= one[:2] + ROUNDING).all()


@pytest.mark.parametrize("frame", ["tool", "base"])
def test_what_only_turns_freely_may_also_tilt(frame: Frame) -> None:
    arm = kinseek.load("ur5e")
    T = plain_fk(arm.chain, random_joints(arm.chain, 100, seed=14))
    answer = arm.ik(Goal.pose(T, free="rz", frame=frame))
    tilted = Goal.pose(T, free="rz", box={"rx": (-1e-5, 1e-5), "ry": (-1e-5, 1e-5)}, frame=frame)
    assert answer.success.all()
    arrays = kinseek.Problem(arm.chain, tilted).arrays
    assert (judge_ranges(arrays, answer.q, tilted.questions, 1.0, 1.0)[:, :2] <= 1e-6 + ROUNDING).all()


@pytest.mark.parametrize("name", ["iiwa14", "panda", "irb5400"])
def test_ranges_that_end_near_a_half_turn(name: str) -> None:
    arm = kinseek.load(name)
    T = plain_fk(arm.chain, singular_joints(arm.chain, 300, seed=15))
    wanted = targets_from(T, np.c_[np.zeros((300, 5)), np.linspace(3.0, 3.1, 300)], "tool")
    solution = arm.ik(Goal.pose(wanted, box={"rz": (3.0, 3.1)}))
    errors = outside(deviation(plain_fk(arm.chain, solution.q), wanted, "tool"), {"rz": (3.0, 3.1)}, ())
    assert (errors <= 1e-6 + ROUNDING).all()
    assert solution.success.all()


SMALL = [name for name in catalog_names() if 3 <= catalog_entry(name).dof <= 5]


@pytest.mark.slow
@pytest.mark.parametrize("name", SMALL)
def test_arms_of_three_to_five_joints_reach_positions_and_directions(name: str) -> None:
    """`python -m benchmarks.partial_goals` does the same with 12,000 targets each."""
    arm = kinseek.load(name)
    q = np.vstack([random_joints(arm.chain, 1000, seed=16), singular_joints(arm.chain, 200, seed=17)])
    T = plain_fk(arm.chain, q)
    for free in (("rx", "ry", "rz"), ("rx",), ("rz",)):
        solution = arm.ik(Goal.pose(T, free=free))
        off = plain_fk(arm.chain, solution.q)
        assert (np.linalg.norm(off[:, :3, 3] - T[:, :3, 3], axis=1) <= 1e-6 + ROUNDING).all()
        if len(free) == 1:
            column = AXES.index(free[0]) - 3
            cross = np.cross(off[:, :3, column], T[:, :3, column])
            cosine = (off[:, :3, column] * T[:, :3, column]).sum(axis=1)
            assert (np.arctan2(np.linalg.norm(cross, axis=1), cosine) <= 1e-6 + ROUNDING).all()
        assert ((solution.q >= arm.lower) & (solution.q <= arm.upper)).all()
        assert solution.success.all()


def test_batches_threads_and_single_goals_give_the_same_bits() -> None:
    arm = kinseek.load("panda")
    T = plain_fk(arm.chain, random_joints(arm.chain, 70, seed=10))
    q0 = random_joints(arm.chain, 70, seed=11)
    goal = Goal.pose(T, free=("z", "rx"), box={"rz": (-0.2, 0.3)})
    for near in (None, q0):
        together = arm.ik(goal, threads=1, near=near)
        np.testing.assert_array_equal(arm.ik(goal, threads=2, near=near).q, together.q)
        for i in range(0, 70, 7):
            one = arm.ik(goal.at(T[i]), near=None if near is None else near[i])
            np.testing.assert_array_equal(one.q, together.q[i])
            assert one.position_error == together.position_error[i]
    assert arm.ik(goal.at(np.zeros((0, 4, 4)))).q.shape == (0, 7)


def test_near_stays_near() -> None:
    arm = kinseek.load("ur5e")
    q0 = random_joints(arm.chain, 50, seed=12)
    T = plain_fk(arm.chain, q0)
    goal = Goal.pose(T, free=("x", "y"), box={"rz": (-0.1, 0.1)})
    np.testing.assert_array_equal(arm.ik(goal, near=q0).q, q0)
    start = np.clip(q0 + 0.05, arm.lower, arm.upper)
    close, far = arm.ik(goal, near=start), arm.ik(goal)
    assert close.success.all()
    gaps = [np.linalg.norm(answer.q - start, axis=1) for answer in (close, far)]
    assert (gaps[0] <= 0.05 * np.sqrt(6) + 0.01).mean() >= 0.9
    assert (gaps[0] <= gaps[1] + 1e-9).mean() >= 0.95


def test_out_of_reach_gives_the_nearest_and_says_so() -> None:
    arm = kinseek.load("ur5e")
    far = kinseek.pose([3.0, 0.0, 0.2])
    ranged = arm.ik(Goal.pose(far, free="rz", frame="base"))
    pointing = arm.ik(Goal.pose(far, free="rz"))
    assert not ranged.success
    # The same set of poses: Newton's method settles a direction, ranges are only polished.
    assert pointing.weighted_error <= ranged.weighted_error * (1 + 1e-9)
    assert ranged.weighted_error == pytest.approx(pointing.weighted_error, rel=1e-4)
    weighted = ranged.position_error + 1 - np.cos(ranged.orientation_error)
    assert ranged.weighted_error == pytest.approx(weighted, rel=1e-12)
    assert not arm.ik(Goal.pose(far, box={"x": (-0.1, 0.1)})).success
    assert arm.ik(Goal.pose(far, free="x", frame="base")).success


def test_the_nearest_is_where_geometry_puts_it() -> None:
    arm = kinseek.load("planar2")  # Links of 0.5 m and 0.25 m.
    solution = arm.ik(Goal.position([2.0, 0.0, 0.3], box={"x": (-0.1, 0.1), "z": (-0.2, 0.0)}))
    assert solution.position_error == pytest.approx(np.hypot(1.9 - 0.75, 0.1), abs=1e-9)
    np.testing.assert_allclose(arm.fk(solution.q)[:2, 3], [0.75, 0.0], atol=1e-5)


TOOL = kinseek.pose([0.1, -0.05, 0.2], rotvec=[0.3, 0.2, -1.0])
BASE = kinseek.pose([1.0, 2.0, 0.5], rotvec=[0.1, 0.0, 0.7])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "so101", "ur10e_rail", "scara4"])
def test_tool_and_base_are_what_transforms_by_hand_give(name: str) -> None:
    arm = kinseek.load(name)
    tip = plain_fk(arm.chain, random_joints(arm.chain, 50, seed=13))
    asked = BASE @ tip @ TOOL
    goals = [
        Goal.pose(asked, tool=TOOL, base=BASE),
        Goal.position(asked[:, :3, 3], tool=TOOL, base=BASE),
        Goal.pose(asked, free="rz", tool=TOOL, base=BASE),
        Goal.pose(asked, free=("z", "ry"), tool=TOOL, base=BASE),
        Goal.pose(asked, free=("z", "ry"), frame="base", tool=TOOL, base=BASE),
    ]
    for goal in goals:
        solution = arm.ik(goal)
        assert solution.success.all(), goal.kind
        off = deviation(BASE @ plain_fk(arm.chain, solution.q) @ TOOL, asked, goal.frame)
        assert (np.linalg.norm(off[:, :2], axis=1) <= 1e-6 + ROUNDING).all()
        if goal.kind == "pose":
            assert (np.linalg.norm(off[:, 3:], axis=1) <= 1e-6 + ROUNDING).all()
    by_hand = arm.ik(np.linalg.inv(BASE) @ asked @ np.linalg.inv(TOOL))
    assert by_hand.success.all()


@pytest.mark.parametrize("solver", [kinseek.CoordinateDescent(), kinseek.BlindSearch()])
def test_other_solvers_take_tool_and_base(solver: kinseek.Solver) -> None:
    arm = kinseek.load("planar2")
    q = np.array([0.4, -0.7])
    goal = Goal.position((BASE @ arm.fk(q) @ TOOL)[:3, 3], tool=TOOL, base=BASE)
    solution = arm.ik(goal, solver=solver, near=q + 0.01)
    assert solution.position_error < 1e-4
    reached = (BASE @ arm.fk(solution.q) @ TOOL)[:3, 3]
    np.testing.assert_allclose(
        np.linalg.norm(reached - goal.target[:3, 3]), solution.position_error, atol=1e-12
    )


def test_a_proof_knows_the_tool() -> None:
    arm = kinseek.load("ur5e")
    long = kinseek.pose([0.0, 0.0, 0.5])
    reach = kinseek.pose([1.3, 0.0, 0.2])
    assert arm.prove(Goal.position(reach[:3, 3])).verdict is kinseek.Verdict.UNREACHABLE
    assert arm.prove(Goal.position(reach[:3, 3], tool=long)).verdict is kinseek.Verdict.REACHABLE


def test_tools_share_samples_and_are_forgotten() -> None:
    arm = kinseek.load("planar2")
    own = atlas_of(arm.chain)
    for i in range(3 * MOST_CACHED):
        tool = kinseek.pose([0.01 * i + 0.01, 0.0, 0.0])
        index = atlas_of(arm.chain, Goal.pose(np.eye(4), tool=tool))
        assert index.sorted.tree.points is own.sorted.tree.points
        atlas_of(arm.chain, Goal.position(np.zeros(3), tool=tool), 64)
    assert atlas_of(arm.chain) is own
    from kinseek.solvers.atlas.index import _indices

    assert len(_indices.of(arm.chain)) <= MOST_CACHED + 2


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"free": None}, "free must be the name of an axis or several of them, got None"),
        ({"free": "q"}, r"unknown axis 'q'\. Valid: rx, ry, rz, x, y, z"),
        ({"free": ("z", "ry2")}, "unknown axis 'ry2'; did you mean"),
        ({"box": {"roll": (0, 1)}}, "unknown axis 'roll'"),
        ({"free": "x", "box": {"x": (0, 1)}}, "x cannot be both free and boxed"),
        ({"box": {"x": (0.2, 0.1)}}, r"box\['x'\] must have lower <= upper, got \(0.2, 0.1\)"),
        ({"box": {"x": (np.nan, 0.1)}}, "lower <= upper, got"),
        ({"box": {"x": (np.inf, np.inf)}}, "lower <= upper, got"),
        ({"box": {"x": 0.1}}, r"box\['x'\] must be a pair"),
        ({"box": {"x": (0, 1, 2)}}, r"box\['x'\] must be a pair"),
        ({"box": {"x": ("a", "b")}}, r"box\['x'\] must be a pair"),
        ({"box": [("x", 0, 1)]}, "box must map axes to ranges"),
        ({"box": {"rz": (-4.0, 1.0)}}, r"must lie within \[-π, π\] rad, got \(-4, 1\).*free='rz'"),
        ({"box": {"rz": (0.0, np.inf)}}, r"must lie within \[-π, π\]"),
        ({"box": {"rx": (3, 3.1), "ry": (3, 3.1)}}, "no rotation lies in this box.*4.243"),
        ({"free": AXES}, "nothing is constrained"),
        ({"free": AXES[:5], "box": {"rz": (-math.pi, math.pi)}}, "nothing is constrained"),
        ({"free": "x", "frame": "world"}, "frame must be 'tool' or 'base', got 'world'"),
        ({"tool": np.zeros((4, 4))}, "tool: not a rigid transform"),
        ({"base": np.eye(3)}, "base: a pose must have shape"),
        ({"tool": np.stack([np.eye(4)] * 2)}, r"tool must be one pose, \(4, 4\)"),
    ],
)
def test_contradictory_boxes(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InvalidGoal, match=words):
        Goal.pose(np.eye(4), **options)


def test_what_positions_and_directions_refuse() -> None:
    with pytest.raises(InvalidGoal, match="a position goal already defines its orientation"):
        Goal.position([0, 0, 0], free="rx")
    with pytest.raises(InvalidGoal, match="nothing is constrained"):
        Goal.position([0, 0, 0], free=("x", "y", "z"))
    with pytest.raises(InvalidGoal, match="a pointing goal already defines its orientation"):
        Goal.pointing([0, 0, 0], [0, 0, 1], box={"rz": (0, 1)})
    with pytest.raises(InvalidGoal, match="a goal has ranges if and only if"):
        Goal(np.eye(4), kind="box")
    with pytest.raises(InvalidGoal, match="ranges must be six pairs"):
        Goal(np.eye(4), kind="box", ranges=((0.0, 1.0),))


@pytest.mark.parametrize("solver", [solver for solver in kinseek.ALL_SOLVERS if solver is not kinseek.Atlas])
def test_other_solvers_refuse_ranges(solver: type[kinseek.Solver]) -> None:
    arm = kinseek.load("planar2")
    with pytest.raises(InvalidProblem, match="supported: a whole pose, a direction, a position"):
        arm.ik(Goal.pose(np.eye(4), free=("x", "rz")), solver=solver())


COMBINED: dict[str, dict[str, Any]] = {
    "cone": {"free": ("rz",), "cone": 0.2},
    "two": {"box": {"rx": (-0.2, 0.2), "ry": (-0.1, 0.3)}},
    "three": {"box": {"rx": (-0.2, 0.2), "ry": (-0.1, 0.3), "rz": (-0.5, 0.5), "z": (-0.02, 0.05)}},
    "slide": {"free": ("x", "rx"), "frame": "base"},
}
HERE = kinseek.pose([0.4, 0.2, 0.3], rpy=[math.pi, 0.0, 0.5])


@pytest.mark.parametrize("ranges", COMBINED.values(), ids=COMBINED)
def test_goals_with_ranges_take_every_option(ranges: dict[str, Any]) -> None:
    arm = kinseek.load("ur5e")
    goal, scene = Goal.pose(HERE, **ranges), kinseek.Scene.of(arm, capsules=0.05)
    sample = arm.branches(goal)
    assert isinstance(sample, Branches)
    assert len(sample) == 50
    assert sample.sampled
    near = np.array([0.0, -1.5, 1.5, 0.0, 0.0, 0.0])
    options: dict[str, dict[str, Any]] = {
        "near": {"near": near},
        "cost": {"cost": lambda q: np.abs(q[:, 0] - 0.3)},
        "valid": {"valid": lambda q: bool(q[2] < 0)},
        "scene": {"scene": scene, "clearance": 0.01},
        "limits": {"prefer": "limits"},
        "mid-range": {"prefer": "mid-range"},
        "dexterity": {"prefer": "dexterity"},
    }
    solutions = {name: arm.ik(goal, **option) for name, option in options.items()}
    for solution in solutions.values():
        assert solution.success
        assert goal.met(goal.measure(arm.axes.arrays, solution.q[None]))[0]  # type: ignore[union-attr]
    assert (np.abs(sample.q[:, 0] - 0.3)).min() + 1e-3 >= abs(solutions["cost"].q[0] - 0.3)
    assert solutions["valid"].q[2] < 0
    assert scene.distance(solutions["scene"].q) >= 0.01
    assert (np.abs(solutions["limits"].q / arm.upper).max()) <= np.abs(sample.q / arm.upper).max(
        axis=1
    ).min() + 1e-3
    ordered = arm.branches(goal, near=near, count=20).q
    gaps = np.linalg.norm(ordered - near, axis=1)
    assert (np.diff(gaps) >= 0).all()
    accepted = arm.branches(goal, valid=options["valid"]["valid"])
    assert isinstance(accepted, Branches)
    assert (accepted.q[:, 2] < 0).all()
    assert len(accepted) + accepted.rejected == 50


def test_a_tilt_avoids_what_the_straight_tool_hits() -> None:
    arm = kinseek.load("ur5e")
    goal = Goal.pose(HERE, free="rz", cone=0.9)
    scene = kinseek.Scene.of(arm, capsules=0.03)
    # A body on the tool axis above the target: no turn about that axis avoids it.
    scene.add_box("body", (0.02, 0.02, 0.04), HERE @ kinseek.pose([0.0, 0.0, -0.075]))
    assert arm.ik(Goal.pose(HERE, free="rz"), scene=scene).status is Status.BLOCKED
    solution = arm.ik(goal, scene=scene)
    assert solution.success
    assert scene.free(solution.q)
    assert goal.met(goal.measure(arm.axes.arrays, solution.q[None]))[0]  # type: ignore[union-attr]


def test_batches_take_options_target_by_target() -> None:
    arm = kinseek.load("ur5e")
    T = np.array(
        [HERE, kinseek.pose([0.3, -0.4, 0.2], rpy=[math.pi, 0.2, 0.0]), kinseek.pose([2.0, 0.0, 0.0])]
    )
    frames: tuple[Frame, ...] = ("tool", "base")
    for frame in frames:  # In the base the axes of the ranges change from target to target.
        goal = Goal.pose(T, box={"rx": (-0.2, 0.2)}, frame=frame)
        together = arm.branches(goal)
        assert isinstance(together, BranchesBatch)
        assert together.counts.tolist() == [50, 50, 0]
        preferred = arm.ik(goal, prefer="limits")
        assert preferred.success.tolist() == [True, True, False]
        for i in range(3):
            np.testing.assert_array_equal(
                np.array(list(arm.branches(goal.at(T[i])))), np.array(list(together[i]))
            )
            np.testing.assert_array_equal(arm.ik(goal.at(T[i]), prefer="limits").q, preferred.q[i])
    assert len(arm.branches(goal.at(T[:0]))) == 0


@pytest.mark.parametrize("ranges", COMBINED.values(), ids=COMBINED)
def test_nothing_in_reach_is_proved_out_of_reach(ranges: dict[str, Any]) -> None:
    arm = kinseek.load("ur5e")
    goal = Goal.pose(HERE, **ranges)
    rng, case = (
        np.random.default_rng(12),
        {"free": (), "box": {}} | {k: v for k, v in ranges.items() if k != "cone"},
    )
    q = random_joints(arm.chain, 20, seed=13)
    q[:, 2] *= 1e-3 * rng.random(20)  # Nearly stretched: the goals lie at the end of the workspace.
    wanted = targets_from(plain_fk(arm.chain, q), away(case, 20, seed=14), ranges.get("frame", "tool"))
    for T in wanted:
        one = Problem(arm.chain, goal.at(T))
        missed = conclude(one, one.start[None], np.zeros((1, 3), dtype=np.int64))
        certificate = prove(one, solution=missed, budget=20_000)
        assert certificate.verdict is not Verdict.UNREACHABLE
        assert certificate.lower_bound <= 1e-12


def test_goals_with_ranges_are_proved_out_of_reach() -> None:
    arm = kinseek.load("ur5e")
    for ranges in (
        {"free": "rz", "cone": 0.2},
        {"box": {"rx": (-0.2, 0.2), "ry": (-0.1, 0.3), "z": (-0.1, 0.0)}},
    ):
        goal = Goal.pose(np.array([HERE, kinseek.pose([1.2, 0.0, 0.0])]), **ranges)
        solution = arm.ik(goal, prove=True)
        assert solution.status.tolist() == [Status.SOLVED, Status.PROVED_UNREACHABLE]
        certificate = arm.prove(goal.at(goal.target[1]))
        assert certificate.verdict is Verdict.UNREACHABLE
        assert 0.0 < certificate.lower_bound < certificate.upper_bound
        narrow = arm.prove(goal.at(goal.target[1]), gap=0.2)
        assert certificate.lower_bound <= narrow.lower_bound < narrow.upper_bound


@pytest.mark.parametrize(
    ("name", "ranges"), [("scara4", {"free": "rz", "cone": 0.2}), ("puma560", {"box": {"rz": (-0.3, 0.4)}})]
)
def test_a_gap_bounds_the_error_of_a_goal_with_ranges(name: str, ranges: dict[str, Any]) -> None:
    arm = kinseek.load(name)
    goal = Goal.pose(kinseek.pose([0.9, 0.2, 0.5], rpy=[3.0, 0.4, 0.0]), **ranges)
    certificate = arm.prove(goal, gap=0.1, budget=20_000)
    assert certificate.verdict is Verdict.UNREACHABLE
    assert certificate.lower_bound >= 0.4 * certificate.upper_bound
    errors = Problem(arm.chain, goal).errors_of(random_joints(arm.chain, 20_000, seed=3))
    assert certificate.lower_bound <= errors[:, 2].min()


def test_the_gap_counts_one_angle_and_not_two_axes() -> None:
    """The orientation is missed by 0.9 rad about z, which turns the x and the y axis: the error counts it once."""
    arm = kinseek.load("planar2")
    T = arm.fk(np.array([0.3, 1.0])) @ kinseek.pose([0.0, 0.0, 0.0], rpy=[0.0, 0.0, 1.0])
    certificate = arm.prove(Goal.pose(T, box={"rz": (-0.1, 0.1)}, position_weight=10.0), gap=0.02)
    assert 0.97 / 2 < certificate.lower_bound / (1 - np.cos(0.9)) < 1.0
    assert certificate.upper_bound == pytest.approx(1 - np.cos(0.9), abs=1e-6)


def test_a_pose_of_the_longer_arm_is_no_proof() -> None:
    """Outside the ranges by less than the virtual joints allow: not reached, and not proved."""
    arm = kinseek.load("planar2").with_limits({"joint1": (0.1, 0.1), "joint2": (0.2, 0.2)})
    tool = kinseek.pose([0.1, 0.0, 0.0], rotvec=[0.9, -0.7, 0.5])
    R = arm.fk(np.array([0.1, 0.2])) @ tool
    ends = Rotation.from_matrix(R[:3, :3]).as_rotvec()
    ends[0] -= 1e-4
    box = {"rx": (-1.0, ends[0]), "ry": (-1.0, 1.0), "rz": (-1.0, 1.0)}
    goal = Goal.pose(kinseek.pose(R[:3, 3]), box=box, tool=tool)
    assert not arm.ik(goal).success
    assert arm.prove(goal).verdict is not Verdict.REACHABLE


def test_corners_of_the_ranges_at_the_limits_of_the_joints_are_reached() -> None:
    """There a step that is free inside the ranges turns back and forth; see `solvers.atlas.ranges`."""
    arm, rng = kinseek.load("so101"), np.random.default_rng(4)
    for _ in range(100):
        q = arm.lower + rng.choice([0.0, 0.5, 1.0], arm.dof) * (arm.upper - arm.lower)
        ends = np.zeros((6, 2))
        for i in rng.permutation(6)[:3]:
            ends[i, 0] = rng.uniform(-0.5, 0.1)
            ends[i, 1] = ends[i, 0] + 10 ** rng.uniform(-3, -0.3)
        corner = ends[np.arange(6), rng.choice([0, 1], 6)]
        wanted = targets_from(arm.fk(q)[None], corner[None], "base")[0]
        goal = Goal.pose(wanted, box=dict(zip(AXES, map(tuple, ends), strict=True)), frame="base")
        assert arm.ik(goal).success


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_narrow_ranges_far_from_zero_have_a_branch_wherever_they_are_solved(name: str) -> None:
    """The sample is of slightly larger ranges; none of it may lie in the ranges of the goal."""
    arm = kinseek.load(name)
    box = {"rx": (0.1, 0.4), "ry": (0.2, 0.3), "rz": (-1.0, -0.2)}
    goal = Goal.pose(arm.fk(arm.sample(60, seed=5)), box=box)
    found = arm.branches(goal)
    assert isinstance(found, BranchesBatch)
    for i, (one, solved) in enumerate(zip(found, arm.ik(goal).success, strict=True)):
        assert bool(len(one)) >= solved, f"pose {i}"
        for q in one.q:
            D = goal.target[i, :3, :3].T @ arm.fk(q)[:3, :3]
            w = Rotation.from_matrix(D).as_rotvec()
            assert (w >= np.array([0.1, 0.2, -1.0]) - 1e-6).all()
            assert (w <= np.array([0.4, 0.3, -0.2]) + 1e-6).all()
