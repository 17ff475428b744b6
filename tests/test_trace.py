"""A trace says what a search did, pass by pass, and asking for it changes nothing but that."""

from __future__ import annotations

import copy
import json
import pickle
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from chains import random_poses
from inlined import inlined
from kinseek.errors import InvalidProblem, InvalidUse
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.problem import Problem
from kinseek.solution import Solution
from kinseek.solvers.atlas import tracing
from kinseek.solvers.base import Solver
from kinseek.solvers.every import ALL_SOLVERS
from kinseek.trace import SHOWN, WIDTH, Pass, Trace

NUMBERS = (
    *("q", "success", "position_error", "orientation_error", "weighted_error"),
    *("evaluations", "nodes_created", "nodes_expanded", "out_of_time", "proved_unreachable", "rejected"),
)

SEARCHES: dict[str, Solver] = {
    "atlas": kinseek.Atlas(),
    "brute force": kinseek.BruteForce(branching_factor=6),
    "brute force, early": kinseek.BruteForce(branching_factor=6, stop_below=0.9, order="random"),
    "divide and conquer": kinseek.DivideAndConquer(breadth=2),
    "divide and conquer, static": kinseek.DivideAndConquer(branching_factor=100, tree="static", divisions=4),
    "divide and conquer, beam": kinseek.DivideAndConquer(breadth=2, beam=4, children=2),
    "divide and conquer, tuned": kinseek.DivideAndConquer(breadth="tuned", node_budget=500),
    "divide and conquer, by the formula": kinseek.DivideAndConquer(breadth=2, first="formula"),
    "divide and conquer, to the letter": kinseek.DivideAndConquer(breadth=2, limited="letter"),
    "divide and conquer, turned lattice": kinseek.DivideAndConquer(divisions=4, offset=0.25, ties="first"),
    "divide and conquer, early": kinseek.DivideAndConquer(breadth=2, beam=3, stop_below=0.05),
    "divide and conquer, reaching": kinseek.DivideAndConquer(breadth="reach"),
    "separate chains": kinseek.SeparateChains(breadth=2),
    "blind search": kinseek.BlindSearch(),
    "blind search, fixed changes": kinseek.BlindSearch(shrink=None),
    "blind search, few steps": kinseek.BlindSearch(most_steps=5),
    "coordinate descent": kinseek.CoordinateDescent(),
    "coordinate descent, single": kinseek.CoordinateDescent(pairs=False, most_sweeps=7),
    "polished": kinseek.Polished(kinseek.DivideAndConquer(breadth=2)),
    "polished by blind search": kinseek.Polished(
        kinseek.DivideAndConquer(breadth=2), kinseek.BlindSearch(step=0.01)
    ),
}


def same(one: Solution, other: Solution, but: tuple[str, ...] = ()) -> None:
    for name in NUMBERS:
        if name not in but:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def holds_together(solution: Solution) -> None:
    """Every promise of the trace of one target, checked against its solution."""
    trace: Trace = solution.trace
    last = trace[-1]
    assert trace.evaluations[-1] == solution.evaluations
    assert trace.nodes_created == solution.nodes_created
    assert trace.nodes_expanded == solution.nodes_expanded
    assert all(each.evaluations >= 0 and each.memory > 0 for each in trace)
    np.testing.assert_array_equal(last.q, solution.q)
    assert (last.weighted_error, last.position_error, last.orientation_error) == (
        *(solution.weighted_error, solution.position_error, solution.orientation_error),
    )
    assert trace.joint_names == solution.problem.mechanism.joint_names
    assert all(len(line) <= WIDTH for line in str(trace).splitlines())


@pytest.mark.slow
@pytest.mark.parametrize("robot", ["planar2", "scara4", "elbow6"])
@pytest.mark.parametrize("search", SEARCHES)
def test_asking_changes_no_bit_and_the_passes_add_up(robot: str, search: str) -> None:
    arm = kinseek.load(robot)
    for target in random_poses(arm, 3, 1):
        plain = arm.ik(target, solver=SEARCHES[search])
        traced = arm.ik(target, solver=SEARCHES[search], trace=True)
        same(plain, traced)
        holds_together(traced)


def test_every_search_keeps_a_trace() -> None:
    arm = kinseek.load("planar2")
    for cls in ALL_SOLVERS:
        assert isinstance(arm.ik(arm.fk([1.0, 1.0]), solver=cls(), trace=True).trace, Trace)


@pytest.mark.slow
@pytest.mark.parametrize("near", [None, 0.3])
@pytest.mark.parametrize("robot", ["panda", "gen3", "scara4"])
def test_the_atlas_tells_every_round(robot: str, near: float | None) -> None:
    arm = kinseek.load(robot)
    poses = random_poses(arm, 24, 1)
    span = arm.chain.reach
    out = poses[::2, :3, 3]  # At the edge of reach: farther away no restart is tried.
    out *= np.linspace(0.8, 0.95, len(out))[:, None] * span / np.linalg.norm(out, axis=1)[:, None]
    start = None if near is None else np.clip(near, arm.lower, arm.upper)
    seen: set[str] = set()
    for pose in poses:
        traced = arm.ik(pose, near=start, trace=True)
        same(arm.ik(pose, near=start), traced)
        holds_together(traced)
        seen |= {each.name.lstrip("0123456789 ") for each in traced.trace}
        for each in traced.trace:
            if each.start is not None:
                assert each.start_error > 0.0
    assert {"look-up", "nearest samples", "restarts", "nearest pose"} <= seen or near is not None


@pytest.mark.slow
def test_a_round_of_the_atlas_begins_at_its_samples() -> None:
    # A solved round leads from its seed to its answer, and the seed is near the goal already.
    arm = kinseek.load("jaco2_6")
    for pose in random_poses(arm, 10, 1):
        trace = arm.ik(pose, trace=True).trace
        first = trace[1]
        assert first.name == "4 nearest samples"
        assert first.start is not None
        np.testing.assert_allclose(trace[0].weighted_error, first.start_error, atol=0.5)
        assert trace[-1].weighted_error < first.start_error < 1.0
        assert trace[0].spacing is not None
        assert np.isfinite(trace[0].spacing).any()


def test_seeds_are_read_where_the_desk_has_them() -> None:
    # Memory is read by hand there; the kernels' own view of it has to agree.
    dof, joints = 5, 6
    memory = np.zeros(LAYOUT.count.of(dof=dof, joints=joints))
    laid = inlined(LAYOUT.make)(memory.ctypes.data, dof, joints)
    laid.lanes.q[:] = np.arange(8 * dof).reshape(dof, 8)
    laid.state[:] = [0, 2, 1, 0, 2, 2, 2, 2]
    seeds = tracing.filled_lanes(memory, dof, joints)
    assert [seed.tolist() for seed in seeds] == [laid.lanes.q[:, 0].tolist(), laid.lanes.q[:, 3].tolist()]


@pytest.mark.slow
def test_a_batch_has_a_trace_for_each() -> None:
    arm = kinseek.load("scara4")
    poses = random_poses(arm, 6, 1).reshape(2, 3, 4, 4)
    for search in (kinseek.DivideAndConquer(), kinseek.CoordinateDescent(), kinseek.Polished(), None):
        traced = arm.ik(poses, solver=search, trace=True)
        # A plain batch is answered eight targets at a time, each counted by itself; a trace takes them one by one.
        same(arm.ik(poses, solver=search), traced, but=("evaluations",) if search is None else ())
        assert traced.trace.shape == (2, 3)
        for one in traced.each():
            holds_together(one)
        same(arm.ik(poses[1, 2], solver=search), traced[1, 2])
        part = traced[:, 1:]
        assert part.trace.shape == (2, 2)
        assert part.trace[1, 1] is traced.trace[1, 2]
        assert traced[1, 0].trace is traced.trace[1, 0]


def test_a_trace_is_kept_in_copies_and_pickles() -> None:
    arm = kinseek.load("planar2")
    one = arm.ik(arm.fk([1.0, 1.0]), solver=kinseek.DivideAndConquer(), trace=True)
    many = arm.ik(arm.fk([[1.0, 1.0], [2.0, 1.0]]), solver=kinseek.DivideAndConquer(), trace=True)
    for kept in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one)), replace(one)):
        assert str(kept.trace) == str(one.trace)
    assert str(pickle.loads(pickle.dumps(many)).trace[1]) == str(many.trace[1])


def test_a_trace_that_was_not_asked_for_says_how() -> None:
    arm = kinseek.load("planar2")
    for solution in (
        arm.ik(arm.fk([1.0, 1.0])),
        arm.ik(arm.fk([[1.0, 1.0]]), solver=kinseek.DivideAndConquer()),
        pickle.loads(pickle.dumps(arm.ik(arm.fk([1.0, 1.0])))),
    ):
        with pytest.raises(InvalidUse, match="trace=True"):
            _ = solution.trace


def test_a_search_of_ones_own_keeps_none() -> None:
    class Still:
        def solve(self, problem: Problem) -> Solution:
            return kinseek.Atlas().solve(replace(problem, trace=False))

    class Middle:
        def solve(self, problem: Problem) -> Solution:
            from kinseek.solvers.base import Found, solve_each

            return solve_each(problem, lambda one, _: Found(one.start, 1))

    arm = kinseek.load("planar2")
    target = arm.fk([1.0, 1.0])
    with pytest.raises(InvalidUse, match="no trace"):
        _ = arm.ik(target, solver=Still(), trace=True).trace
    with pytest.raises(InvalidUse, match="Recorder"):
        _ = arm.ik(target, solver=Middle(), trace=True).trace
    with pytest.raises(InvalidUse, match="Recorder"):
        _ = arm.ik(target, solver=kinseek.Polished(Middle()), trace=True).trace


@pytest.mark.slow
@pytest.mark.parametrize(
    "search", [kinseek.Atlas(), kinseek.DivideAndConquer(), kinseek.BlindSearch(), kinseek.Polished()]
)
def test_traces_of_a_million_are_refused_with_their_memory(search: Solver) -> None:
    arm = kinseek.load("planar2")
    many = np.broadcast_to(arm.fk([1.0, 1.0]), (1_000_000, 4, 4))
    with pytest.raises(
        InvalidUse, match=r"1,000,000 targets would take up to [\d,.]+ [GT]iB .*at most [\d,]+ at a"
    ):
        arm.ik(many, solver=search, trace=True)


def test_the_memory_that_is_refused_is_an_upper_bound() -> None:
    import tracemalloc

    from kinseek.trace import pass_memory

    arm = kinseek.load("elbow6")
    poses = random_poses(arm, 20, 1)
    search = kinseek.DivideAndConquer()
    arm.ik(poses, solver=search, trace=True)
    tracemalloc.start()
    solution = arm.ik(poses, solver=search, trace=True)
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    passes = sum(len(trace) for trace in solution.trace)
    assert held < passes * pass_memory(6) + 20 * 512 + 200_000


def test_a_choice_among_branches_has_no_trace() -> None:
    arm = kinseek.load("planar2")
    with pytest.raises(InvalidProblem, match="no trace"):
        arm.ik(arm.fk([1.0, 1.0]), prefer="limits", trace=True)


def test_with_a_proof_the_trace_stays() -> None:
    arm = kinseek.load("planar2")
    far = arm.fk([1.0, 1.0])
    far[0, 3] += 5.0
    solution = arm.ik(far, prove=True, trace=True)
    assert solution.proved_unreachable
    holds_together(solution)


@pytest.mark.slow
@pytest.mark.parametrize("budget", [1, 50, 400, 3000])
@pytest.mark.parametrize("search", SEARCHES)
def test_within_a_budget_too(search: str, budget: int) -> None:
    arm = kinseek.load("scara4")
    for target in random_poses(arm, 2, 1):
        problem = Problem(arm.chain, kinseek.Goal.pose(target), budget=budget)
        traced = SEARCHES[search].solve(replace(problem, trace=True))
        same(SEARCHES[search].solve(problem), traced)
        if len(traced.trace):
            holds_together(traced)
        else:
            assert traced.evaluations == 0
        if budget == 1 and "brute" in search:
            assert traced.trace.notes == ("The budget of 1 evaluations is spent.",)


def test_a_time_limit_is_noted() -> None:
    arm = kinseek.load("elbow6")
    search = kinseek.DivideAndConquer(breadth=4, beam=4000)
    solution = arm.ik(random_poses(arm, 2, 1), solver=search, time_limit=0.05, trace=True)
    assert solution.out_of_time.all()
    assert solution.trace[0].notes == ("The time limit ended the search.",)
    holds_together(solution[0])
    late = solution.trace[1]
    assert len(late) == 0
    assert "before this search began" in late.notes[0]
    assert "no passes" in repr(late)
    assert str(late).startswith("no search")


READINGS: dict[str, dict[str, Any]] = {
    "as it is": {},
    "without wrapping": {"wrap": False},
    "formula": {"first": "formula"},
    "letter": {"limited": "letter"},
    "formula and letter": {"first": "formula", "limited": "letter", "wrap": False},
    "offset": {"offset": 0.375},
    "static": {"tree": "static"},
}


@pytest.mark.slow
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("robot", ["planar2", "cylindrical3"])
def test_windows_are_those_of_the_search(robot: str, reading: str) -> None:
    # Every window holds the best node before it and the best of its own pass, with the spacing that it says, and as many
    # leaves as were evaluated.
    arm = kinseek.load(robot)
    search = kinseek.DivideAndConquer(breadth=2, **READINGS[reading])
    full = (arm.upper - arm.lower) * arm.chain.wraps * search.wrap
    for target in random_poses(arm, 5, 1):
        trace = arm.ik(target, solver=search, trace=True).trace
        for before, each in pairwise([None, *trace]):
            assert each.evaluations == np.prod(each.counts)
            for d in range(arm.dof):
                values = each.values(d)
                tried = [each.q[d]] if before is None else [each.q[d], before.q[d]]
                # The nodes of a first pass are rounded to the grid.
                step = (arm.upper[d] - arm.lower[d]) / 7199
                for q in tried:
                    away = np.abs(values - q)
                    if full[d]:
                        away = np.minimum(away, np.abs(away - full[d]))
                    assert away.min() < 1e-9 + step * (before is None)
                np.testing.assert_allclose(np.diff(values), each.spacing[d], rtol=1e-9)
                if not full[d]:
                    assert values[0] >= arm.lower[d] - 1e-9
                    assert values[-1] <= arm.upper[d] + 1e-9
                elif before is not None:
                    assert values[0] <= before.q[d] + 1e-9
                    assert values[-1] >= before.q[d] - 1e-9


def test_a_breadth_that_cannot_walk_back_is_noted() -> None:
    arm = kinseek.load("planar2")
    target = arm.fk([2.0, 1.1])
    short = arm.ik(target, solver=kinseek.DivideAndConquer(breadth=2), trace=True).trace
    assert [note.partition(":")[0] for note in short.notes] == ["joint1, joint2"]
    assert all("breadth='reach'" in note for note in short.notes)
    assert arm.ik(target, solver=kinseek.DivideAndConquer(breadth="reach"), trace=True).trace.notes == ()


def test_an_early_stop_is_noted() -> None:
    arm = kinseek.load("planar2")
    target = arm.fk([2.0, 1.1])
    for search in (
        kinseek.DivideAndConquer(breadth="reach", stop_below=0.5),
        kinseek.BruteForce(stop_below=0.5),
    ):
        trace = arm.ik(target, solver=search, trace=True).trace
        assert trace.notes[-1].endswith("a weighted error below 0.5.")


def test_a_window_of_a_joint_that_was_turned_goes_with_it() -> None:
    rows = [[0.5, 0.0, 0.0, 0.0], [0.25, 0.0, 0.0, 0.0]]
    arm = kinseek.Arm.from_dh(rows, [-np.inf, -np.inf], [np.inf, np.inf])
    near = np.array([20.0, -20.0])
    traced = arm.ik(arm.fk(near + 0.3), near=near, solver=kinseek.DivideAndConquer(breadth=2), trace=True)
    holds_together(traced)
    for each in traced.trace:
        assert (np.abs(each.q - near) <= np.pi + 1e-9).all()
        assert (each.lower <= each.q + 1e-9).all()
        assert (each.q <= each.upper + each.spacing + 1e-9).all()


def test_cells_of_a_beam_are_counted() -> None:
    arm = kinseek.load("planar2")
    trace = arm.ik(arm.fk([2.0, 1.1]), solver=kinseek.DivideAndConquer(breadth=2, beam=4), trace=True).trace
    assert [each.cells for each in trace] == [1] + [4] * (len(trace) - 1)
    assert "4 x 5" in str(trace)


def test_a_trace_can_be_exported(tmp_path: Path) -> None:
    arm = kinseek.load("planar2")
    trace = arm.ik(arm.fk([2.0, 1.1]), solver=kinseek.DivideAndConquer(breadth=2), trace=True).trace
    read = json.loads(trace.save(tmp_path / "trace.json").read_text())
    assert read == trace.to_dict()
    with pytest.raises(kinseek.InvalidProblem, match=r"folder .* does not exist"):
        trace.save(tmp_path / "nowhere" / "trace.json")
    assert read["passes"][1]["q"] == trace[1].q.tolist()
    assert read["passes"][1]["start_error"] is None
    rows = trace.rows()
    assert len(rows) == len(trace)
    assert len({tuple(row) for row in rows}) == 1
    assert rows[-1]["evaluations_so_far"] == trace.evaluations[-1]
    assert rows[1]["lower_joint2"] == trace[1].lower[1]


def test_a_long_trace_is_printed_in_part() -> None:
    one = Pass("a name much longer than what a column has room for", np.zeros(2), 0.5, 0.25, 0.125, 10**12)
    trace = Trace("Long", ("a", "b"), ("revolute", "prismatic"), (one,) * 1000, ("A note. " * 30,))
    lines = str(trace).splitlines()
    assert len(lines) < SHOWN + 15
    assert any("960 more" in line for line in lines)
    assert max(map(len, lines)) <= WIDTH
    assert "Pass('a name" in repr(one)
    with pytest.raises(InvalidUse, match="no window"):
        one.values(0)


@pytest.mark.slow
@pytest.mark.parametrize("search", SEARCHES)
def test_functions_too(search: str) -> None:
    if "blind" in search or "tuned" in search:
        pytest.skip("these refuse functions")
    inner = kinseek.load("planar2")
    arm = kinseek.Arm.from_fk(inner.fk, inner.lower, inner.upper, kinds="revolute")
    for target in random_poses(inner, 2, 1):
        target[:3, 3] *= 1.0 if target[0, 3] > 0 else 1.5
        plain = arm.ik(target, solver=SEARCHES[search])
        traced = arm.ik(target, solver=SEARCHES[search], trace=True)
        same(plain, traced)
        holds_together(traced)


@pytest.mark.slow
def test_free_axes_have_a_trace_too() -> None:
    arm = kinseek.load("panda")
    pose = random_poses(arm, 1, 1)[0]
    for goal in (kinseek.Goal.pose(pose, free=["rz"]), kinseek.Goal.pose(pose, free=["x", "rz"])):
        traced = arm.ik(goal, trace=True)
        same(arm.ik(goal), traced)
        holds_together(traced)


def test_a_long_name_of_a_pass_keeps_its_number_in_the_table() -> None:
    arm = kinseek.load("planar2")
    far = kinseek.pose([0.2, 0.1, 0.3])
    search = kinseek.Polished(kinseek.SeparateChains(), kinseek.CoordinateDescent())
    trace = arm.ik(far, solver=search, trace=True).trace
    lines = str(trace).splitlines()
    wide = [line for line in lines if line.startswith("first: place, wi")]
    assert len(wide) > 1
    assert len({line[:21] for line in wide}) == len(wide)
    assert max(map(len, lines)) <= 80
