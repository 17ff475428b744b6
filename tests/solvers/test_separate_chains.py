"""Separate chains: which joints leave a point at rest, what is searched after what, and what it saves."""

from __future__ import annotations

import gc
import weakref
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kinseek
from chains import random_poses, serial_chains
from kinseek import DivideAndConquer, Goal, Problem, SeparateChains
from kinseek.errors import FailedKinematics, InvalidProblem, InvalidSolver, InvalidUse
from kinseek.robots.chain import SerialChain
from kinseek.solvers.chain_split import MOST_CACHED, Split, _known, find_split
from reference import errors, fk, weighted_error


def goal_of(arm: kinseek.Arm, kind: str, **options: Any) -> Goal:
    T = random_poses(arm, 1)[0]
    return {
        "pose": Goal.pose(T, **options),
        "position": Goal.position(T[:3, 3], **options),
        "pointing": Goal.pointing(T[:3, 3], T[:3, 2], **options),
    }[kind]


def split_of(name: str, kind: str = "pose", **options: Any) -> Split:
    arm = kinseek.load(name)
    return SeparateChains().split(Problem(arm.chain, goal_of(arm, kind, **options)))


@pytest.mark.parametrize(
    ("name", "kind", "first", "second", "idle"),
    [
        ("planar2", "pose", (0,), (1,), ()),
        ("scara4", "pose", (0, 1, 2), (3,), ()),
        ("elbow6", "pose", (0, 1, 2), (3, 4, 5), ()),
        ("elbow6", "pointing", (0, 1, 2), (3, 4, 5), ()),
        ("elbow6", "position", (0, 1, 2), (), (3, 4, 5)),
        ("puma560", "pose", (0, 1, 2), (3, 4, 5), ()),
        ("puma560", "pointing", (0, 1, 2), (3, 4), (5,)),
        ("irb120", "pose", (0, 1, 2), (3, 4, 5), ()),
        ("wx250s", "pose", (0, 1, 2), (3, 4, 5), ()),
        ("so101", "pose", (0, 1, 2), (3, 4), ()),
        ("iiwa14", "pose", (0, 1, 2, 3), (4, 5, 6), ()),
        ("panda", "position", (0, 1, 2, 3, 4, 5), (), (6,)),
        ("panda", "pose", (0, 1, 2, 3, 4, 5, 6), (), ()),
        ("ur5e", "pose", (0, 1, 2, 3, 4, 5), (), ()),
        ("gen3", "pose", (0, 1, 2, 3, 4, 5, 6), (), ()),
        ("cylindrical3", "pose", (0, 1, 2), (), ()),
        ("planar2", "position", (0, 1), (), ()),
    ],
)
def test_the_chains_of_known_arms(
    name: str, kind: str, first: tuple[int, ...], second: tuple[int, ...], idle: tuple[int, ...]
) -> None:
    split = split_of(name, kind)
    assert (split.first, split.second, split.idle) == (first, second, idle)
    assert split.whole == (not second and not idle)
    assert ("as one chain" in split.sentence) == (not second)
    assert split.evaluations > 0


def test_the_point_is_the_wrists_centre_in_the_frame_of_the_tool() -> None:
    np.testing.assert_allclose(split_of("puma560").point, (0, 0, -0.05575), atol=1e-4)
    tool = kinseek.pose([0.1, 0.0, 0.2], rpy=(0.3, 0.0, 0.0))
    split = split_of("puma560", tool=tool)
    at_the_tip = tool[:3, :3] @ np.array(split.point) + tool[:3, 3]
    np.testing.assert_allclose(at_the_tip, split_of("puma560").point, atol=1e-9)
    assert split.second == (3, 4, 5)


def test_joints_that_stand_between_the_others() -> None:
    """A SCARA arm whose last joint slides: what turns before it leaves the tip at rest."""
    rows = [(0.5, 0, 0, 0), (0.25, 0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0)]
    arm = kinseek.Arm.from_dh(rows, [0, 0, 0, 0], [6, 6, 6, 0.25], kinds="RRRP")
    solver = SeparateChains(again=np.inf)
    T = random_poses(arm, 20)
    split = solver.split(Problem(arm.chain, Goal.pose(T)))
    assert (split.first, split.second) == ((0, 1, 3), (2,))
    whole, chains = arm.ik(T, solver=DivideAndConquer(breadth=4)), arm.ik(T, solver=solver)
    assert np.median(chains.weighted_error) <= 1.1 * np.median(whole.weighted_error)
    assert np.mean(chains.evaluations) < 0.15 * np.mean(whole.evaluations)


def test_a_point_as_far_as_a_hardly_tilted_axis_puts_it() -> None:
    """What is at rest under a joint that tilts the hand by next to nothing is farther off than numbers can be squared."""
    arm = kinseek.load(
        """<robot name="tilted"><link name="a"/><link name="b"/><link name="c"/>
        <joint name="turn" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 1e-165 1"/>
          <limit lower="0" upper="1" effort="1" velocity="1"/></joint>
        <joint name="fixed" type="fixed"><parent link="b"/><child link="c"/><origin xyz="0 1 0"/></joint></robot>"""
    )
    assert find_split(arm.chain, Goal.pointing([0, 0, 0], [0, 0, 1])).first == (0,)


@pytest.mark.slow
@given(serial_chains(most=4), st.integers(0, 2**32 - 1), st.sampled_from(["pose", "position", "pointing"]))
def test_what_is_said_to_rest_rests(chain: SerialChain, seed: int, kind: str) -> None:
    arm = kinseek.Arm(chain)
    goal = goal_of(arm, kind)
    split = find_split(chain, goal)
    assert sorted(split.first + split.second + split.idle) == list(range(chain.dof))
    assert split.first
    q, other = np.random.default_rng(seed).uniform(chain.lower, chain.upper, (2, chain.dof))
    reach = max(1.0, float(np.abs(fk(chain, q)[:3, 3]).max()))
    for joints, w in ((split.second, np.array(split.point)), (split.idle, np.zeros(3))):
        moved = q.copy()
        moved[list(joints)] = other[list(joints)]
        T, U = fk(chain, q), fk(chain, moved)
        np.testing.assert_allclose(T[:3, :3] @ w + T[:3, 3], U[:3, :3] @ w + U[:3, 3], atol=2e-5 * reach)
        if joints == split.idle:
            axes = goal.tip_rotation[:, : goal.columns]
            np.testing.assert_allclose(T[:3, :3] @ axes, U[:3, :3] @ axes, atol=2e-5)


@pytest.mark.slow
@given(
    serial_chains(most=4),
    st.integers(0, 2**32 - 1),
    st.sampled_from(["pose", "position", "pointing"]),
    st.sampled_from([None, 1, 2, 7, 50, 10_000]),
)
def test_of_any_arm_the_answer_is_judged_and_the_budget_kept(
    chain: SerialChain, seed: int, kind: str, budget: int | None
) -> None:
    del seed
    arm = kinseek.Arm(chain)
    goal = goal_of(arm, kind, position_weight=3.0, base=kinseek.pose([0.1, 0, 0], rpy=(0, 0.2, 0)))
    solution = SeparateChains(30, breadth=1).solve(Problem(chain, goal, budget=budget))
    assert budget is None or 0 < solution.evaluations <= budget
    assert ((solution.q >= chain.lower) & (solution.q <= chain.upper)).all()
    assert goal.base is not None
    inside = Goal(np.linalg.inv(goal.base) @ goal.target, goal.kind, goal.tool_axis, position_weight=3.0)
    T = fk(chain, solution.q)
    assert solution.position_error == pytest.approx(errors(T, inside)[0], rel=1e-6, abs=1e-9)
    assert solution.weighted_error == pytest.approx(weighted_error(T, inside), rel=1e-6, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "count", "smaller", "cheaper"), [("elbow6", 150, 3.0, 0.01), ("scara4", 150, 1.0, 0.15)]
)
def test_what_it_saves(name: str, count: int, smaller: float, cheaper: float) -> None:
    """At a breadth of 4, on the same poses as the whole arm."""
    arm = kinseek.load(name)
    T = random_poses(arm, count, 1)
    whole, chains = arm.ik(T, solver=DivideAndConquer(breadth=4)), arm.ik(T, solver=SeparateChains())
    assert smaller * np.mean(chains.position_error) <= np.mean(whole.position_error)
    assert smaller * np.mean(chains.orientation_error) <= np.mean(whole.orientation_error)
    assert np.mean(chains.evaluations) <= cheaper * np.mean(whole.evaluations)


def test_without_a_split_it_is_divide_and_conquer() -> None:
    arm = kinseek.load("cylindrical3")
    T = random_poses(arm, 5)
    mine, whole = arm.ik(T, solver=SeparateChains(breadth=2)), arm.ik(T, solver=DivideAndConquer(breadth=2))
    np.testing.assert_array_equal(mine.q, whole.q)
    np.testing.assert_array_equal(mine.evaluations, whole.evaluations)
    np.testing.assert_array_equal(mine.nodes_expanded, whole.nodes_expanded)


def test_a_position_is_a_search_of_the_joints_that_move_it() -> None:
    arm = kinseek.load("elbow6")
    places = random_poses(arm, 5)[:, :3, 3]
    solution = arm.ik(Goal.position(places), solver=SeparateChains(breadth=(2, 2, 3, 1, 1, 1)))
    middle = dict(zip(arm.joint_names[3:], [np.pi] * 3, strict=True))
    less = arm.with_locked(middle).ik(Goal.position(places), solver=DivideAndConquer(breadth=(2, 2, 3)))
    np.testing.assert_array_equal(solution.q[:, :3], less.q)
    np.testing.assert_array_equal(solution.q[:, 3:], np.full((5, 3), np.pi))
    np.testing.assert_array_equal(solution.evaluations, less.evaluations)


def test_chains_one_after_the_other_by_hand() -> None:
    """The wrist locked and a position first, then the first joints locked and the pose."""
    arm = kinseek.load("puma560")
    first, second = arm.joint_names[:3], arm.joint_names[3:]
    middle = dict(zip(second, ((arm.lower + arm.upper) / 2)[3:], strict=True))
    search = DivideAndConquer(breadth=2)
    solver = SeparateChains(breadth=2, again=np.inf)
    for T in random_poses(arm, 5):
        centre = kinseek.pose(SeparateChains().split(Problem(arm.chain, Goal.pose(T))).point)
        place = (
            arm.with_locked(middle).with_tool(centre).ik(Goal.position((T @ centre)[:3, 3]), solver=search)
        )
        wrist = arm.with_locked(dict(zip(first, place.q, strict=True))).ik(T, solver=search)
        solution = arm.ik(T, solver=solver)
        np.testing.assert_allclose(solution.q, [*place.q, *wrist.q], atol=1e-12)
        assert solution.evaluations == place.evaluations + wrist.evaluations
        assert solution.nodes_expanded == place.nodes_expanded + wrist.nodes_expanded


def test_once_more_where_it_is_worth_it() -> None:
    arm = kinseek.load("elbow6")
    T = random_poses(arm, 60)
    once, more, always = (
        arm.ik(T, solver=SeparateChains(breadth=2, again=again)) for again in (np.inf, 1e-3, 0.0)
    )
    assert (more.weighted_error <= once.weighted_error).all()
    np.testing.assert_array_equal(more.evaluations > once.evaluations, once.weighted_error > 1e-3)
    assert np.mean(more.position_error) < 0.5 * np.mean(once.position_error)
    assert np.mean(more.orientation_error) <= np.mean(once.orientation_error)
    assert (always.evaluations > 5 * once.evaluations).all()


def test_a_goal_within_its_tolerances_is_not_searched_again() -> None:
    arm = kinseek.load("elbow6")
    T = random_poses(arm, 60)
    exact, loose = (
        arm.ik(
            Goal.pose(T, position_tolerance=size, orientation_tolerance=size),
            solver=SeparateChains(breadth=2),
        )
        for size in (1e-6, 0.02)
    )
    once = arm.ik(T, solver=SeparateChains(breadth=2, again=np.inf))
    near = (once.position_error <= 0.02) & (once.orientation_error <= 0.02)
    assert (exact.evaluations[near] > once.evaluations[near]).any()
    np.testing.assert_array_equal(loose.evaluations[near], once.evaluations[near])
    assert (loose.success >= near).all()


def test_weights_are_heeded_by_what_is_worth_a_second_search() -> None:
    arm = kinseek.load("elbow6")
    T = random_poses(arm, 20)
    solver = SeparateChains(breadth=2)
    light = arm.ik(Goal.pose(T), solver=solver)
    heavy = arm.ik(Goal.pose(T, position_weight=8.0, orientation_weight=8.0), solver=solver)
    np.testing.assert_array_equal(light.evaluations, heavy.evaluations)
    np.testing.assert_array_equal(light.q, heavy.q)


def test_a_function_is_split_by_asking() -> None:
    arm = kinseek.load("scara4")
    asked: list[int] = []

    def poses(q: np.ndarray) -> np.ndarray:
        asked.append(len(q))
        return arm.fk(q)

    box = kinseek.Arm.from_fk(poses, arm.lower, arm.upper, kinds=arm.chain.kinds)
    T = random_poses(arm, 3)
    solver = SeparateChains(breadth=2)
    asked.clear()
    split = solver.split(Problem(box.mechanism, Goal.pose(T)))
    assert (split.first, split.second) == ((0, 1, 2), (3,))
    assert sum(asked) == split.evaluations
    asked.clear()
    found, exact = box.ik(T, solver=solver), arm.ik(T, solver=solver)
    np.testing.assert_allclose(found.q, exact.q, atol=1e-12)
    assert abs(sum(asked) - np.sum(found.evaluations)) <= 3 * 7, "but for those that judge each search"
    asked.clear()
    solver.split(Problem(box.mechanism, Goal.pose(T)))
    assert not asked, "once is enough"


def test_a_function_of_one_row_that_may_not_close() -> None:
    def pose(q: np.ndarray) -> np.ndarray:
        x = np.eye(4)
        c, s = np.cos(q[1]), np.sin(q[1])
        x[:2, :2] = [[c, -s], [s, c]]
        x[0, 3] = q[0] if q[0] < 0.9 else np.nan
        return x

    arm = kinseek.Arm.from_fk(pose, [0, 0], [1, 6], vectorized=False, partial=True)
    T = arm.fk([0.3, 1.0])
    solver = SeparateChains(200, breadth=2)
    assert solver.split(Problem(arm.mechanism, Goal.pose(T))).second == (1,)
    solution = arm.ik(T, solver=solver)
    assert solution.position_error < 0.005
    assert solution.orientation_error < 0.03


def test_a_function_that_fails_names_all_joint_values() -> None:
    arm = kinseek.load("scara4")
    broken: list[bool] = []

    def poses(q: np.ndarray) -> np.ndarray:
        return arm.fk(q) * (np.nan if broken else 1.0)

    box = kinseek.Arm.from_fk(poses, arm.lower, arm.upper)
    solver = SeparateChains(breadth=2)
    box.ik(arm.fk(arm.lower), solver=solver)
    broken.append(True)
    with pytest.raises(FailedKinematics, match="gave NaN") as caught:
        box.ik(arm.fk(arm.lower), solver=solver)
    assert caught.value.q.shape == (4,)


@pytest.mark.slow
def test_what_is_found_out_is_kept_as_long_as_the_arm_and_no_longer() -> None:
    arm = kinseek.load("scara4")
    box = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper)
    T = random_poses(arm, 1)[0]
    for each in (arm.with_limits({}), box):
        for number in range(MOST_CACHED + 3):
            each.ik(
                Goal.pose(T, tool=kinseek.pose([0.01 * number, 0, 0])), solver=SeparateChains(10, breadth=1)
            )
        assert len(_known.of(each.mechanism)) == MOST_CACHED
    gone = weakref.ref(each.mechanism), weakref.ref(box.mechanism)
    del each, box
    gc.collect()
    assert [ref() for ref in gone] == [None, None]


@pytest.mark.slow
def test_a_tuned_breadth_is_tuned_chain_by_chain() -> None:
    arm = kinseek.load("scara4")
    T = random_poses(arm, 20)
    solver = SeparateChains(breadth="tuned", node_budget=400)
    tuned, plain = arm.ik(T, solver=solver), arm.ik(T, solver=SeparateChains(breadth=1))
    assert np.mean(tuned.weighted_error) < np.mean(plain.weighted_error)
    np.testing.assert_array_equal(tuned.q, arm.ik(T, solver=solver).q)
    late = solver.solve(Problem(kinseek.load("scara4").chain, Goal.pose(T), time_limit=1e-9))
    assert late.out_of_time.all()
    box = kinseek.Arm.from_fk(arm.fk, arm.lower, arm.upper)
    with pytest.raises(InvalidSolver, match="too expensive for black-box kinematics"):
        box.ik(T, solver=solver)


def test_parameters_that_do_not_fit_are_refused() -> None:
    arm = kinseek.load("elbow6")
    T = random_poses(arm, 1)[0]
    with pytest.raises(InvalidSolver, match="breadth must be one number or 6, one per joint"):
        arm.ik(T, solver=SeparateChains(breadth=(1, 2, 3)))
    with pytest.raises(InvalidSolver, match="offset must be one number or 6, one per joint; got 5"):
        arm.ik(T, solver=SeparateChains(offset=(None, 0.5, None, None, 0.5)))
    with pytest.raises(InvalidProblem, match="supported: a whole pose, a direction, a position"):
        arm.ik(Goal.pose(T, free="x"), solver=SeparateChains())


def test_the_papers_rule_for_ties_goes_with_the_wider_beam() -> None:
    arm = kinseek.load("elbow6")
    T = random_poses(arm, 1)[0]
    once = arm.ik(T, solver=SeparateChains(ties="first", again=np.inf))
    again = arm.ik(T, solver=SeparateChains(ties="first", again=0.0))
    assert again.evaluations > once.evaluations
    assert again.weighted_error <= once.weighted_error


def test_what_is_below_the_wanted_error_is_not_searched_again() -> None:
    arm = kinseek.load("elbow6")
    T = arm.fk([0.3, 0.4, 0.5, 0.6, 0.7, 0.8])
    once = arm.ik(T, solver=SeparateChains(stop_below=0.01, again=np.inf))
    solution = arm.ik(T, solver=SeparateChains(stop_below=0.01))
    assert 1e-3 < once.weighted_error < 0.01
    assert solution.evaluations == once.evaluations


@pytest.mark.parametrize("count", [1, 30])
def test_a_batch_has_one_bar_and_not_two_a_target(count: int, capsys: pytest.CaptureFixture[str]) -> None:
    arm = kinseek.load("planar2")
    arm.ik(random_poses(arm, count), solver=SeparateChains(breadth=2, again=np.inf, progress=True))
    lines = [line for line in capsys.readouterr().err.splitlines() if "solving" in line]
    assert 1 <= len(lines) <= 2


def test_a_long_batch_is_told_beforehand(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from kinseek.solvers import nodes

    monkeypatch.setattr(nodes, "LONG", 1e-4)
    monkeypatch.setattr(nodes, "_WORTH_MEASURING", 10**5)
    arm = kinseek.load("planar2")
    arm.ik(random_poses(arm, 10), solver=SeparateChains())
    told = capsys.readouterr().err.splitlines()
    assert len(told) == 1
    assert "nodes for each of 10 targets, about" in told[0]


def test_a_chain_of_one_joint_is_told_as_one() -> None:
    assert "so joint1 is searched for its position, then joint2" in split_of("planar2").sentence


def test_a_second_chain_that_would_take_for_ever_is_refused_before_the_first_is_searched() -> None:
    arm = kinseek.load("elbow6")
    T = random_poses(arm, 1)[0]
    solver = SeparateChains(breadth=(1, 1, 1, 5000, 5000, 5000))
    with pytest.raises(InvalidSolver, match="the search would visit"):
        arm.ik(T, solver=solver)
    late = arm.ik(T, solver=solver, time_limit=0.2)
    assert late.out_of_time
    assert late.evaluations > 0


def test_the_command_line_has_it(capsys: pytest.CaptureFixture[str]) -> None:
    from kinseek.cli import main

    pose = ("--at", "0.3", "0.2", "-0.1", "--rpy", "0", "0", "0.3")
    with pytest.raises(SystemExit):
        main(
            [
                "solve",
                "scara4",
                *pose,
                "--solver",
                "separate-chains",
                "--breadth",
                "2",
                "--again",
                "0.01",
                "--json",
            ]
        )
    assert '"q"' in capsys.readouterr().out


@pytest.mark.parametrize("options", [{}, {"budget": 300}, {"time_limit": 1e-9}])
def test_a_trace_tells_the_chains_and_every_pass(options: Any) -> None:
    arm = kinseek.load("elbow6")
    goal = Goal.pose(random_poses(arm, 8))
    solver = SeparateChains(breadth=2)
    plain = solver.solve(Problem(arm.chain, goal, **options))
    told = solver.solve(Problem(arm.chain, goal, trace=True, **options))
    np.testing.assert_array_equal(told.q, plain.q)
    np.testing.assert_array_equal(told.evaluations, plain.evaluations)
    for one in told.each():
        trace = one.trace
        if "time_limit" in options:
            assert not len(trace)
            continue
        assert trace.notes[0] == solver.split(one.problem).sentence
        assert trace.evaluations[-1] == one.evaluations
        assert (trace.nodes_created, trace.nodes_expanded) == (one.nodes_created, one.nodes_expanded)
        np.testing.assert_array_equal(trace[-1].q, one.q)
        assert trace[-1].weighted_error == pytest.approx(one.weighted_error)
        first = trace[0]
        assert first.name == "place: pass 1"
        np.testing.assert_array_equal(first.counts, [3, 3, 3, 1, 1, 1])
        np.testing.assert_array_equal(np.isnan(first.spacing), [False] * 3 + [True] * 3)
        np.testing.assert_array_equal(first.lower[3:], first.q[3:])
        wrist = next(each for each in trace if each.name.startswith("goal: pass 1"))
        np.testing.assert_array_equal(wrist.counts, [1, 1, 1, 3, 3, 3])
    if not options:
        assert any(each.name.startswith("place, wider") for one in told.each() for each in one.trace)


def test_the_trace_says_that_there_is_no_split() -> None:
    arm = kinseek.load("cylindrical3")
    T = random_poses(arm, 2)
    one, both = (
        SeparateChains(breadth=1).solve(Problem(arm.chain, Goal.pose(t), trace=True)) for t in (T[0], T)
    )
    for trace in (one.trace, *(each.trace for each in both.each())):
        assert trace.search == "SeparateChains"
        assert trace.notes[0].startswith(
            "turn, lift, reach are searched as one chain: no joint leaves a point"
        )


def test_a_trace_of_a_million_is_refused() -> None:
    arm = kinseek.load("planar2")
    goal = Goal.pose(np.broadcast_to(np.eye(4), (10**6, 4, 4)))
    with pytest.raises(InvalidUse, match="iB"):
        SeparateChains().solve(Problem(arm.chain, goal, trace=True))
