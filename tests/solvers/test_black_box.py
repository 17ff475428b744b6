"""Arms of which only a function is known: the function is checked, counted and asked inside the limits only."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Any

import numba
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

import kinseek
from benchmarks.black_box import example_case
from benchmarks.targets import plain_fk, pose_errors, random_joints, singular_joints, strict
from kinseek import Goal, InvalidProblem, InvalidRobot, InvalidSolver, KinseekError, Problem, Status
from kinseek.errors import FailedKinematics
from kinseek.solvers.black_box.samples import nearest_columns

Array = NDArray[np.float64]

ARMS = ("ur5e", "puma560", "jaco2_6", "panda", "so101", "scara4")


@lru_cache
def wrapped(name: str, kinds: bool = True) -> tuple[kinseek.Arm, kinseek.Arm]:
    """A bundled arm, and the same as a function."""
    arm = kinseek.load(name)
    chain = arm.chain
    words = chain.kinds if kinds else None
    function = partial(plain_fk, chain)
    return arm, kinseek.Arm.from_fk(
        function, chain.lower, chain.upper, names=chain.joint_names, kinds=words, name=name
    )


def turn(q: Array) -> Array:
    """One joint that turns about z, 0.5 m away, (k, 1) -> (k, 4, 4)."""
    T = np.tile(np.eye(4), (len(q), 1, 1))
    c, s = np.cos(q[:, 0]), np.sin(q[:, 0])
    T[:, 0, 0], T[:, 0, 1], T[:, 1, 0], T[:, 1, 1] = c, -s, s, c
    T[:, 0, 3], T[:, 1, 3] = 0.5 * c, 0.5 * s
    return T


def planar(q: Array) -> Array:
    """Three links of 1.0, 0.8 and 0.5 m in a plane, (n,) -> (4, 4)."""
    T = np.eye(4)
    angle = x = y = 0.0
    for value, length in zip(q, (1.0, 0.8, 0.5), strict=True):
        angle += value
        x, y = x + length * np.cos(angle), y + length * np.sin(angle)
    c, s = np.cos(angle), np.sin(angle)
    T[:2, :2], T[:2, 3] = [[c, -s], [s, c]], [x, y]
    return T


@numba.njit
def planar_compiled(q: Array) -> Array:
    T = np.eye(4)
    angle = x = y = 0.0
    for i in range(3):
        angle += q[i]
        length = (1.0, 0.8, 0.5)[i]
        x, y = x + length * np.cos(angle), y + length * np.sin(angle)
    T[0, 0], T[0, 1], T[1, 0], T[1, 1] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
    T[0, 3], T[1, 3] = x, y
    return T


LOWER, UPPER = np.full(3, -3.0), np.full(3, 3.0)


# --- what is solved -------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
@pytest.mark.parametrize("kinds", [True, False])
def test_a_catalog_arm_as_a_function_is_solved_as_often(name: str, kinds: bool) -> None:
    arm, box = wrapped(name, kinds)
    q = np.concatenate([random_joints(arm.chain, 40, 3), singular_joints(arm.chain, 20, 3)])
    targets = plain_fk(arm.chain, q)
    solution = box.ik(targets)
    assert strict(arm.chain, solution.q, targets)[:40].all()
    assert solution.success[40:].sum() >= 19
    np.testing.assert_array_equal(strict(arm.chain, solution.q, targets), solution.success)


@pytest.mark.parametrize("kind", ["position", "pointing"])
def test_a_looser_goal_of_a_reached_pose_is_reached(kind: str) -> None:
    arm, box = wrapped("so101")
    for T in arm.fk(random_joints(arm.chain, 25, 8)):
        goal = Goal.position(T[:3, 3]) if kind == "position" else Goal.pointing(T[:3, 3], T[:3, 2])
        assert box.ik(goal).success


def test_tighter_than_a_difference_quotient() -> None:
    arm, box = wrapped("ur5e")
    T = arm.fk(random_joints(arm.chain, 20, 9))
    solution = box.ik(Goal.pose(T, position_tolerance=1e-11, orientation_tolerance=1e-11))
    assert solution.success.all()
    assert solution.position_error.max() <= 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5e", "so101", "scara4"])
def test_out_of_reach_it_comes_as_near_as_the_compiled_atlas(name: str) -> None:
    arm, box = wrapped(name)
    T = arm.fk(random_joints(arm.chain, 6, 4))
    T[:, :3, 3] *= 4.0
    solution, witness = box.ik(T), np.array([arm.ik(each).weighted_error for each in T])
    assert list(solution.status) == [
        Status.SOLVED if each else Status.BEST_EFFORT for each in solution.success
    ]
    assert (solution.weighted_error <= witness * 1.02 + 1e-5).all()


def test_near_is_answered_by_the_answer_nearest_to_it() -> None:
    arm, box = wrapped("ur5e")
    q = random_joints(arm.chain, 20, 2)
    T = arm.fk(q)
    solution = box.ik(T, near=q + 0.05)
    assert solution.success.all()
    # Within a tolerance of 1e-6 m near a singularity.
    assert np.linalg.norm(solution.q - q, axis=1).max() < 0.01
    far = box.ik(T[0], near=np.full(6, 100.0))  # Outside the limits it may lie, the answer not.
    assert far.success
    assert (far.q <= arm.upper).all()


def test_a_batch_has_its_shape_and_an_empty_one_too() -> None:
    arm, box = wrapped("scara4")
    T = arm.fk(random_joints(arm.chain, 6, 1)).reshape(2, 3, 4, 4)
    solution = box.ik(T)
    assert solution.q.shape == (2, 3, 4)
    assert solution.success.shape == solution.evaluations.shape == (2, 3)
    none = np.empty((0, 4, 4))
    empty = box.ik(none)
    assert empty.q.shape == (0, 4)
    assert empty.success.shape == (0,)
    assert box.fk(none[:, 0]).shape == (0, 4, 4)


@pytest.mark.slow
def test_same_bits_again_in_any_batch_and_from_a_fresh_arm() -> None:
    arm, box = wrapped("jaco2_6")
    T = arm.fk(random_joints(arm.chain, 6, 7))
    T[5, :3, 3] += 5.0
    first = box.ik(T)
    np.testing.assert_array_equal(first.q, box.ik(T).q)
    np.testing.assert_array_equal(first.q[2:], box.ik(T[2:]).q)
    np.testing.assert_array_equal(first.q[0], box.ik(T[0]).q)
    again = pickle.loads(pickle.dumps(box)).ik(T)
    np.testing.assert_array_equal(first.q, again.q)
    np.testing.assert_array_equal(first.evaluations, again.evaluations)


@pytest.mark.slow
def test_every_pose_asked_for_is_counted_and_asked_inside_the_limits() -> None:
    arm, _ = wrapped("ur5e")
    seen: list[Array] = []

    def watched(q: Array) -> Array:
        seen.append(q.copy())
        return plain_fk(arm.chain, q)

    box = kinseek.Arm.from_fk(watched, arm.lower, arm.upper, kinds="revolute")
    assert box.atlas.samples == sum(len(q) for q in seen[-2:])
    T = arm.fk(random_joints(arm.chain, 3, 6))
    T[2, :3, 3] += 4.0
    seen.clear()
    solution = box.ik(T)
    assert sum(len(q) for q in seen) == solution.evaluations.sum()
    for solver in (kinseek.DivideAndConquer(), kinseek.BruteForce(3), kinseek.CoordinateDescent(20)):
        box.ik(T[0], solver=solver)  # The first call of the last one tests its premise.
        seen.clear()
        assert box.ik(T[0], solver=solver).evaluations == sum(len(q) for q in seen)
    q = np.concatenate(seen)
    assert ((q >= arm.lower) & (q <= arm.upper)).all()


def test_a_joint_without_a_range_stays() -> None:
    arm, _ = wrapped("panda")
    lower, upper = arm.lower, arm.upper
    lower[2] = upper[2] = 0.3
    box = kinseek.Arm.from_fk(partial(plain_fk, arm.chain), lower, upper, kinds="revolute")
    q = np.random.default_rng(1).uniform(lower, upper, (20, 7))
    solution = box.ik(arm.fk(q))
    assert solution.success.all()
    assert (solution.q[:, 2] == 0.3).all()


@pytest.mark.slow
def test_one_row_at_a_time_and_compiled_rows() -> None:
    slow = kinseek.Arm.from_fk(planar, LOWER, UPPER, vectorized=False)
    fast = kinseek.Arm.from_fk(planar_compiled, LOWER, UPPER, vectorized=False)
    q = np.random.default_rng(0).uniform(LOWER, UPPER, (10, 3))
    np.testing.assert_allclose(slow.fk(q), fast.fk(q), atol=1e-14)
    assert slow.atlas.samples < fast.atlas.samples == 16384
    assert slow.ik(slow.fk(q)).success.all()
    assert fast.ik(fast.fk(q)).success.all()
    again = pickle.loads(pickle.dumps(fast))
    np.testing.assert_array_equal(again.fk(q), fast.fk(q))


def test_single_precision_is_solved_as_far_as_it_goes() -> None:
    arm, _ = wrapped("ur5e")

    def rough(q: Array) -> Any:
        return plain_fk(arm.chain, q).astype(np.float32)

    box = kinseek.Arm.from_fk(rough, arm.lower, arm.upper, kinds="revolute")
    goal = Goal.pose(
        arm.fk(random_joints(arm.chain, 10, 1)), position_tolerance=1e-5, orientation_tolerance=1e-5
    )
    assert box.ik(goal).success.all()


def test_a_joint_that_is_an_angle_takes_the_turn_nearest_to_near() -> None:
    box = kinseek.Arm.from_fk(turn, [-7.0], [7.0], kinds="revolute")
    T = box.fk([0.5])
    assert box.ik(T, near=[0.4]).q[0] == pytest.approx(0.5, abs=1e-6)
    assert box.ik(T, near=[6.5]).q[0] == pytest.approx(0.5 + 2 * np.pi, abs=1e-6)
    endless = kinseek.Arm.from_fk(turn, [0.0], [0.0], kinds="continuous")
    assert endless.upper[0] == np.pi
    assert endless.ik(turn(np.array([[9.0]]))[0]).success
    number = kinseek.Arm.from_fk(turn, [-1.0], [1.0])
    assert not number.ik(T, near=[6.5]).q[0] > 1.0


@pytest.mark.slow
@pytest.mark.parametrize(("example", "variable"), [("07_continuum", "robot"), ("08_five_bar", "linkage")])
def test_the_mechanisms_of_the_examples_are_solved(example: str, variable: str) -> None:
    case = example_case(example, variable, 100, 2)
    T = case.fk(case.random)
    solution = case.arm.ik(T)
    assert solution.success.all()
    away, angle = pose_errors(case.fk(solution.q), T)
    assert max(away.max(), angle.max()) <= 1e-6
    position = case.arm.ik(Goal.position(T[:, :3, 3]))
    assert position.success.all()


def test_a_function_that_is_noisy_to_ten_digits_is_solved() -> None:
    """As one that closes its loops by iteration: the difference quotients must not drown."""
    arm, _ = wrapped("ur5e")

    def noisy(q: Array) -> Array:
        T = plain_fk(arm.chain, q)
        T[:, :3, 3] += 1e-10 * np.sin(1e9 * q[:, :3])
        return T

    box = kinseek.Arm.from_fk(noisy, arm.lower, arm.upper, kinds="revolute")
    assert box.ik(noisy(random_joints(arm.chain, 20, 1))).success.all()


def test_a_progress_bar_does_no_harm() -> None:
    arm, box = wrapped("scara4")
    assert box.ik(arm.fk(random_joints(arm.chain, 3, 1)), progress=True).success.all()


# --- the other searches ---------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    "solver",
    [
        kinseek.DivideAndConquer(),
        kinseek.DivideAndConquer(breadth=(1, 2, 1, 1), beam=4, children=2, tree="static"),
        kinseek.BruteForce(branching_factor=7),
        kinseek.BruteForce(branching_factor=9, order="random", stop_below=0.8),
        kinseek.CoordinateDescent(),
        kinseek.CoordinateDescent(pairs=False),
    ],
    ids=repr,
)
def test_a_search_gives_what_its_compiled_twin_gives(solver: kinseek.Solver) -> None:
    arm, box = wrapped("scara4")
    T = arm.fk(random_joints(arm.chain, 6, 12))
    solution, twin = box.ik(T, solver=solver), arm.ik(T, solver=solver)
    np.testing.assert_allclose(solution.weighted_error, twin.weighted_error, atol=1e-5)
    np.testing.assert_allclose(solution.q, twin.q, atol=1e-4)
    np.testing.assert_array_equal(solution.nodes_expanded >= twin.nodes_expanded, True)


def test_coordinate_descent_finds_out_by_itself_what_turns_and_what_slides() -> None:
    arm, box = wrapped("scara4", kinds=False)
    T = arm.fk(random_joints(arm.chain, 4, 3))
    solver = kinseek.CoordinateDescent()
    np.testing.assert_allclose(
        box.ik(T, solver=solver).weighted_error, arm.ik(T, solver=solver).weighted_error, atol=1e-5
    )


def test_coordinate_descent_names_the_joint_where_its_premise_fails() -> None:
    arm, box = wrapped("irb5400")  # Its fifth joint drives two.
    T = arm.fk(random_joints(arm.chain, 1, 3)[0])
    with pytest.raises(InvalidSolver, match="'joint5' of 'irb5400'"):
        box.ik(T, solver=kinseek.CoordinateDescent())
    bent = kinseek.Arm.from_fk(lambda q: turn(q**2), [0.1], [2.0], names=["crank"])
    with pytest.raises(InvalidSolver, match=r"'crank'.*deviates from both"):
        bent.ik(turn(np.array([[1.0]]))[0], solver=kinseek.CoordinateDescent())


def test_what_needs_axes_says_so() -> None:
    arm, box = wrapped("scara4")
    T = arm.fk(np.zeros(4))
    with pytest.raises(InvalidSolver, match=r"axes and links.*Atlas, BruteForce"):
        box.ik(T, solver=kinseek.BlindSearch())
    with pytest.raises(InvalidSolver, match="tuned"):
        box.ik(T, solver=kinseek.DivideAndConquer(breadth="tuned"))
    assert box.axes is None
    for thing in (box, Problem(box.mechanism, Goal.pose(T))):
        with pytest.raises(InvalidProblem, match=r"axes and links.*'scara4' has black-box kinematics"):
            thing.chain  # noqa: B018
    for call in (lambda: box.prove(T), lambda: box.ik(T, prove=True)):
        with pytest.raises(InvalidProblem, match="nothing can be proved"):
            call()


# --- functions that fail --------------------------------------------------------------------------------------------


def broken(kind: str) -> Callable[[Array], Any]:
    """Right up to a corner of the range of the first joint, wrong beyond."""

    def function(q: Array) -> Any:
        T = turn(q).astype(float)
        bad = q[:, 0] > 1.2
        if kind == "raises" and bad.any():
            raise ZeroDivisionError("no such place")
        value = {"nan": np.nan, "inf": np.inf, "scaled": 1.01, "mirrored": -1.0}.get(kind, 1.0)
        if kind in ("nan", "inf"):
            T[bad, 0, 0] = value
        else:
            T[bad, :3, 2] *= value
        T[bad, 3, 3] = 2.0 if kind == "last row" else 1.0
        return T[:-1] if kind == "shape" and bad.any() else T

    return function


SAYS = {
    "raises": "raised ZeroDivisionError: no such place",
    "nan": "gave NaN; .*partial=True",
    "inf": "infinity",
    "scaled": "no rotation",
    "mirrored": "reflection",
    "last row": "last row",
    "shape": "gave shape",
}


@pytest.mark.parametrize("kind", SAYS)
def test_a_failing_function_is_named_with_the_q_that_did_it(kind: str) -> None:
    box = kinseek.Arm.from_fk(broken(kind), [-1.0], [1.5], name="fragile")
    with pytest.raises(FailedKinematics, match=rf"fk of 'fragile'.*{SAYS[kind]}.*q = \[") as caught:
        box.ik(turn(np.array([[1.3]]))[0])
    assert isinstance(caught.value, KinseekError)
    if kind != "shape":
        assert caught.value.q[0] > 1.2
    if kind == "raises":
        assert isinstance(caught.value.__cause__, ZeroDivisionError)
        box.fk([[0.0], [1.1]])
        with pytest.raises(FailedKinematics, match=r"at q = \[1.4\]"):
            box.fk([[0.0], [1.4], [1.3]])
    again = pickle.loads(pickle.dumps(caught.value))
    np.testing.assert_array_equal(again.q, caught.value.q)


@pytest.mark.slow
def test_a_function_of_one_row_that_fails_is_named_too() -> None:
    def half(q: Array) -> Any:
        if q[0] > 0.9:
            raise ValueError("too far")
        return turn(q[None])[0]

    with pytest.raises(FailedKinematics, match="too far"):
        kinseek.Arm.from_fk(half, [-1.0], [1.0], vectorized=False).atlas.samples  # noqa: B018
    with pytest.raises(FailedKinematics, match=r"gave shape \(3, 4\)"):
        kinseek.Arm.from_fk(lambda q: np.eye(4)[:3], [-1.0], [1.0], vectorized=False)

    @numba.njit
    def compiled(q: Array) -> Array:
        if q[0] > 0.9:
            raise ValueError("too far")
        return np.eye(4)

    with pytest.raises(FailedKinematics, match=r"too far; at q = \[0\.9") as caught:
        kinseek.Arm.from_fk(compiled, [-1.0], [1.0], vectorized=False).atlas.samples  # noqa: B018
    assert caught.value.q[0] > 0.9


def test_a_function_that_changes_its_argument_changes_nothing() -> None:
    def greedy(q: Array) -> Array:
        T = turn(q)
        q[:] = 7.0
        return T

    box = kinseek.Arm.from_fk(greedy, [-1.0], [1.0])
    solution = box.ik(turn(np.array([[0.3]]))[0])
    assert solution.q[0] == pytest.approx(0.3, abs=1e-6)


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (planar, "vectorized=False"),
        (lambda q: turn(q - q.mean()), "mixes up its rows"),
        (lambda q: None, "gave shape"),
        (lambda q: turn(q).astype(complex), "real numbers"),
        (lambda q: turn(q).astype(str), "real numbers"),
        (lambda q, more: turn(q), "raised TypeError"),
        (42, "must be a function"),
    ],
)
def test_a_function_that_cannot_be_right_is_refused_at_once(function: Any, message: str) -> None:
    dof = 3 if function is planar else 1
    with pytest.raises(InvalidRobot, match=message):
        kinseek.Arm.from_fk(function, np.full(dof, -1.0), np.full(dof, 1.0))


@pytest.mark.parametrize(
    ("lower", "upper", "options", "message"),
    [
        ([0.0], [1.0, 2.0], {}, "equally long"),
        ([1.0], [0.0], {}, "above upper"),
        ([-np.inf], [np.inf], {}, "continuous"),
        ([np.nan], [1.0], {}, "finite"),
        ([], [], {}, r"shape \(n,\)"),
        (0.0, 1.0, {}, r"shape \(n,\)"),
        (["a"], [1.0], {}, "numbers"),
        ([0.0], [1.0], {"kinds": "revolut"}, "revolute"),
        ([0.0], [1.0], {"kinds": ["number", "number"]}, "one per joint"),
        ([0.0], [1.0], {"names": ["a", "b"]}, "different strings"),
    ],
)
def test_limits_kinds_and_names_are_checked(lower: Any, upper: Any, options: Any, message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        kinseek.Arm.from_fk(turn, lower, upper, **options)


def test_goals_and_starts_are_checked_as_for_any_arm() -> None:
    _, box = wrapped("scara4")
    with pytest.raises(kinseek.InvalidGoal):
        box.ik(np.full((4, 4), np.nan))
    with pytest.raises(InvalidProblem):
        box.ik(np.eye(4), near=np.zeros(5))
    with pytest.raises(InvalidProblem):
        box.fk([np.nan] * 4)


# --- mechanisms that cannot be put together everywhere --------------------------------------------------------------


def crank(q: Array) -> Array:
    """A slider pushed by a rod of 0.4 m on a crank of 0.5 m: beyond some angles the rod is too short."""
    with np.errstate(invalid="ignore"):
        x = 0.5 * np.cos(q[:, 0]) + np.sqrt(0.16 - 0.25 * np.sin(q[:, 0]) ** 2)
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, 0, 3], T[:, 1, 3] = x, q[:, 1]
    T[np.isnan(x)] = np.nan
    return T


def test_nan_is_outside_where_it_is_allowed() -> None:
    edge = np.arcsin(0.8)
    with pytest.raises(FailedKinematics, match="partial=True"):
        kinseek.Arm.from_fk(crank, [-1.5, 0.0], [1.5, 0.2]).atlas.samples  # noqa: B018
    box = kinseek.Arm.from_fk(crank, [-1.5, 0.0], [1.5, 0.2], partial=True)
    assert np.isnan(box.fk([1.4, 0.1])).all()
    assert 0 < box.atlas.samples < 16384
    for angle in (0.0, 0.4, -0.9, edge - 1e-3, -edge + 1e-6):
        solution = box.ik(crank(np.array([[angle, 0.15]]))[0])
        assert solution.success, angle
        assert abs(solution.q[0]) <= edge
    too_far = crank(np.array([[0.0, 0.1]]))[0]
    too_far[0, 3] = 0.05  # The slider comes no nearer than 0.3 m, with the rod across.
    solution = box.ik(too_far)
    assert solution.status is Status.BEST_EFFORT
    assert solution.position_error == pytest.approx(0.25, abs=1e-3)
    searched = box.ik(too_far, solver=kinseek.DivideAndConquer(breadth=4))
    assert searched.weighted_error == pytest.approx(solution.weighted_error, abs=1e-2)


def test_a_mechanism_that_never_closes_is_refused() -> None:
    box = kinseek.Arm.from_fk(lambda q: np.full((len(q), 4, 4), np.nan), [0.0], [1.0], partial=True)
    with pytest.raises(InvalidRobot, match="all of 64 samples"):
        box.ik(np.eye(4))


@pytest.mark.parametrize("size", [1, 7, 500, 20_000])
def test_the_nearest_samples_are_those_of_a_k_d_tree(size: int) -> None:
    rng = np.random.default_rng(size)
    points = np.concatenate([rng.normal(size=(size, 3)), rng.uniform(-1, 1, (size, 6))], axis=1)
    tree, columns = cKDTree(points), np.ascontiguousarray(points.T)
    for target in points[rng.integers(size, size=20)] + rng.normal(size=(20, 9)) * 0.1:
        for count in {1, min(size, 64), min(size, 500)}:
            expected = np.atleast_1d(tree.query(target, count)[1])
            np.testing.assert_array_equal(nearest_columns(columns, target, count), expected)


def test_of_samples_equally_near_the_first_come_first() -> None:
    points = np.zeros((3, 100))
    points[0, 40:] = 1.0
    np.testing.assert_array_equal(nearest_columns(points, np.zeros(3), 60)[:40], np.arange(40))
