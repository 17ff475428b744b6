"""The kernels as plain Python, where an index out of range is an error, beside the same ones compiled.

Under NUMBA_DISABLE_JIT=1 this file runs every search on small inputs, in plain Python, and compares with what machine code
answers in another process. In the ordinary suite it is skipped: `.ci/run` runs it, and fails where less of `kernels/` is
covered than it covered before.

Plain arrays, like compiled ones, take a negative index from their end without a word. What kernels are given and what they
view by address refuses it here, see `kernels.python_backend`; arrays that a kernel makes for itself do not.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek import Atlas, Goal, Problem, Solver
from kinseek.branches import index as branching
from kinseek.collision import Box, Capsule, Cylinder, Sphere
from kinseek.collision.broad import Broad
from kinseek.collision.engine import Solid
from kinseek.kernels.arrays import Limits
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.memory import LAYOUT as DESK
from kinseek.kernels.backend import PLAIN
from kinseek.kernels.maps.many_closed import many_closed
from kinseek.kernels.paths.around import answers_around
from kinseek.kernels.paths.band import solve_band
from kinseek.kernels.paths.limited import FOLLOW, GO, Motion, Room, limited_step, track_step
from kinseek.kernels.paths.limited import STRAIGHT as STRAIGHT_WAY
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.kernels.paths.propagation import Given, propagate_layer, spread_solutions
from kinseek.kernels.paths.servo import State, look_ahead, servo_step
from kinseek.kernels.paths.towards import move_towards
from kinseek.kernels.paths.trace import Leg, part_ways, trace
from kinseek.kernels.paths.viterbi import (
    COPIED,
    DISTANCE,
    ENDLESS,
    GIVEN,
    SQUARES,
    STRAIGHT,
    TIME,
    Layer,
    Layers,
    Rules,
    Sideways,
    Steps,
    Turns,
    viterbi,
    viterbi_step,
)
from kinseek.kernels.proof.neighbourhood import contractions
from kinseek.kernels.python_backend import Bounded, bounded, call_at, unbounded, view_of
from kinseek.kernels.timing.fastest import fastest_profile
from kinseek.kernels.timing.smooth import smooth_profile
from kinseek.kernels.timing.spline import divide_pieces, spline_slopes
from kinseek.kinds import POINTING, POSE
from kinseek.maps.search import ruled_out
from kinseek.paths.certify import margins_of, prove_rows
from kinseek.paths.plan import branch_ends
from kinseek.proof import branch_and_bound, root_isolation
from kinseek.proof.boxes import enclosed, excluded
from kinseek.proof.reduce import error_question, question
from kinseek.proof.shoulder import bounded_by_ball
from kinseek.proof.single_boxes import examine
from kinseek.solvers.atlas.index import PLAIN as PLAIN_TOLERANCES
from kinseek.solvers.atlas.index import AtlasIndex

Array = NDArray[np.float64]

SMALL = Atlas(samples=64, threads=1)

TWO = kinseek.Arm.from_dh([(0.3, 1.2, 0.2, 0), (0.5, 0, 0.1, 0)], [-2.5, -2], [2.5, 3], name="two")
"""Two turns about skew axes."""

SLIDES = kinseek.Arm.from_dh(
    [(0.2, 1.5, 0.1, 0.3), (0.1, 0.2, 0, 0.4), (0.3, 0, 0, 0)],
    [0, -2, -1],
    [1, 2, 1],
    kinds="PRR",
    name="slides",
)
"""A slide that carries two turns."""


def targets(arm: kinseek.Arm, count: int, seed: int = 3) -> Array:
    poses: Array = arm.fk(np.random.default_rng(seed).uniform(arm.lower, arm.upper, (count, arm.dof)))
    return poses


def away(arm: kinseek.Arm, times: float = 2.5) -> Array:
    """A pose out of reach, so many times as far away as one that is reached."""
    T: Array = targets(arm, 1)[0]
    T[:3, 3] *= times
    return T


def one(name: str) -> Any:
    arm = kinseek.load(name)
    solution = arm.ik(targets(arm, 1)[0], solver=SMALL)
    return solution.q, solution.success, solution.evaluations, solution.weighted_error


def batch(name: str) -> Any:
    arm = kinseek.load(name)
    solution = arm.ik(targets(arm, 12), solver=SMALL)
    return solution.q, solution.success, solution.evaluations


def near(name: str) -> Any:
    arm = kinseek.load(name)
    q = np.random.default_rng(3).uniform(arm.lower, arm.upper, (2, arm.dof))
    few = arm.ik(arm.fk(q), near=q + 0.1, solver=SMALL)
    alone = arm.ik(arm.fk(q[0]), near=q[1], solver=SMALL)
    return few.q, few.success, alone.q, alone.success


def out_of_reach(name: str, times: float) -> Any:
    arm = kinseek.load(name)
    solution = arm.ik(away(arm, times), solver=SMALL)
    # A stretched elbow stands at one end of its full turn or at the other: that hangs on the last bit.
    return np.cos(solution.q), np.sin(solution.q), solution.success, solution.weighted_error


def gates(name: str) -> Any:
    arm = kinseek.load(name)
    T = np.concatenate([targets(arm, 3), away(arm)[None]])
    return ruled_out(arm, Goal.pose(T))


def asked(name: str) -> Any:
    arm = kinseek.load(name)
    T, told = np.concatenate([targets(arm, 6), away(arm)[None]])[:, :3], np.empty(7, dtype=np.int64)
    index = AtlasIndex(arm.chain, POSE, arm.chain.arrays, 64)
    left = many_closed(
        index.handle, PLAIN_TOLERANCES, arm.structure.numbers, np.ascontiguousarray(T), told, LANES
    )
    return left, told


def around(name: str) -> Any:
    arm = kinseek.load(name)
    q = np.random.default_rng(3).uniform(arm.lower, arm.upper, (4, arm.dof))
    problem = Problem(arm.mechanism, Goal.pose(arm.fk(q)))
    hold = np.ascontiguousarray(np.linalg.svd(arm.jacobian(q))[2][:, 6:])
    position, held = np.array([1e-3, 1e-4, 1e-5, 0.5]), np.zeros(4, dtype=bool)
    margins = margins_of(problem, q)
    answers_around(arm.chain.arrays, problem.goal.targets, q, hold, position, 2.0 * position, margins, held)
    return held


def positions_and_directions(name: str) -> Any:
    arm = kinseek.load(name)
    T = targets(arm, 2)
    position = arm.ik(Goal.position(T[:, :3, 3]), solver=SMALL)
    pointing = arm.ik(Goal.pointing(T[0, :3, 3], T[0, :3, 2], (0.0, 0.0, 1.0)), solver=SMALL)
    return position.q, position.success, pointing.q, pointing.success


def box(name: str) -> Any:
    arm = kinseek.load(name)
    T = targets(arm, 1)[0]
    within = arm.ik(Goal.pose(T, free="rx", box={"x": (-0.05, 0.1)}), solver=SMALL)
    beyond = arm.ik(Goal.pose(away(arm), box={"x": (-0.05, 0.1), "rx": (-0.2, 0.3)}), solver=SMALL)
    # The steps towards the nearest pose beyond ranges converge slowly: where their number ends, last bits have become 3e-6.
    return within.success, within.position_error < 1e-6, beyond.success, round(beyond.weighted_error, 4)


def plain_calls() -> Any:
    """The short way of a single pose, with the index that `ik` makes itself: all of two joints are few samples."""
    q = np.array([0.3, -0.7])
    place = TWO.ik(Goal.position(TWO.fk(q)[:3, 3]), near=q + 0.05)
    alone, beside = TWO.ik(TWO.fk(q)), TWO.ik(TWO.fk(q), near=q + 0.05)
    return alone.q, alone.success, beside.q, TWO.ik(away(TWO)).weighted_error, place.q


def branches(name: str) -> Any:
    arm = kinseek.load(name)
    found = arm.branches(targets(arm, 1)[0])
    few = arm.branches(targets(arm, 2), near=arm.lower)
    return len(found), in_order(found.q), [len(each) for each in few]


def swept_branches(name: str) -> Any:
    """Of a joint that is swept there are as many answers as are wanted: which ones hangs on the last bit."""
    arm = kinseek.load(name)
    found: Any = arm.branches(targets(arm, 1)[0], count=12)
    return len(found), found.sampled, bool((found.position_error < 1e-6).all())


def nearly_branches() -> Any:
    """Beside a singularity of an arm that nearly has a closed form: poses around the target are tried, and nothing else."""
    arm = kinseek.load("ur10e_calibrated")
    found = arm.branches(arm.fk([0.3, -1.0, 1.2, 0.4, 0.006, 0.2]))
    return len(found), in_order(found.q)


def free_branches() -> Any:
    arm = kinseek.load("scara4")
    found: Any = arm.branches(Goal.position(targets(arm, 1)[0, :3, 3]), count=4)
    return len(found), found.sampled


def all_branches(arm: kinseek.Arm) -> Any:
    found: Any = arm.branches(targets(arm, 1)[0], prove=True)
    return found.complete, in_order(found.q)


def in_order(q: Array) -> Array:
    return np.asarray(q[np.lexsort(np.round(q, 6).T)])


def beside(arm: kinseek.Arm, kind: str) -> Problem:
    """A goal out of reach by so little that boxes have to be looked at."""
    T = targets(arm, 1)[0]
    T[:3, 3] += (0.0, 0.02, 0.05)
    goal = {
        "pose": Goal.pose(T),
        "position": Goal.position(T[:3, 3]),
        "pointing": Goal.pointing(T[:3, 3], T[:3, 2], (0.0, 0.0, 1.0)),
        "cone": Goal.pointing(
            T[:3, 3], -T[:3, 2], (0.0, 0.0, 1.0), position_tolerance=0.3, orientation_tolerance=1.2
        ),
    }[kind]
    return Problem(arm.chain, goal)


def proof(arm: kinseek.Arm, kind: str, gap: float | None, budget: int) -> Any:
    problem = beside(arm, kind)
    known = SMALL.solve(replace(problem, budget=200))
    found = branch_and_bound.prove(problem, gap=gap, budget=budget, threads=1, solution=known)
    return found.verdict.name, found.boxes, found.lower_bound, found.upper_bound


def on_a_ball(name: str, ceiling: float) -> Any:
    """The bound of an arm on a ball joint, far out: all boxes below what is asked for are cut, whatever the order."""
    arm = kinseek.load(name)
    T = arm.fk((arm.lower + arm.upper) / 2)
    T[:3, 3] *= 2.5 / np.linalg.norm(T[:3, 3])
    return tuple(bounded_by_ball(Problem(arm.chain, Goal.pose(T)), ceiling, 400))


def bounds(arm: kinseek.Arm, kind: str, budget: int) -> Any:
    """Both searches of a proof, and the tests of single boxes.

    Which of two equally good boxes is cut first hangs on the last bit, so what a search knows when its budget ends does too.
    """
    problem, middle = beside(arm, kind), (arm.lower + arm.upper) / 2
    without = excluded(problem, budget, threads=1)
    least = enclosed(problem, middle, 0.1, budget, threads=1)
    found: list[Any] = [without.boxes, least.boxes, least.lower <= least.upper]
    for asked in (question(problem), error_question(problem, middle, 0.1)):
        form, wanted, roll = asked
        dof, rng = arm.dof - (1 if roll.present else 0), np.random.default_rng(1)
        half = (arm.upper - arm.lower)[:dof] / 2 * np.array([[1.0], [0.3], [0.1], [0.03], [0.01]])
        boxes = np.hstack([middle[:dof] + rng.uniform(-1, 1, (5, dof)) * (half[0] - half), half])
        for examined in (examine(problem, asked, boxes, ceiling) for ceiling in (None, 0.5, 0.05)):
            found += [np.isnan(examined.left[:, 0, 0]), examined.lower]
        if kind != "cone":  # With more joints than conditions it is next to singular, and nobody asks for it.
            found.append(contractions(form, wanted, boxes))
    return found


def reachable_proof() -> Any:
    """A poor answer handed in, so that the proof has to find a better one itself."""
    T = targets(TWO, 1)[0]
    problem = Problem(TWO.chain, Goal.pose(T, position_tolerance=0.05, orientation_tolerance=0.05))
    poor = replace(SMALL.solve(Problem(TWO.chain, Goal.pose(away(TWO)), budget=200)), problem=problem)
    found = branch_and_bound.prove(problem, budget=300, threads=1, solution=poor)
    return found.verdict.name, found.position_error <= 0.05


def isolated(arm: kinseek.Arm, budget: int) -> Any:
    found = root_isolation.isolate(Problem(arm.chain, Goal.pose(targets(arm, 1)[0])), budget=budget)
    return found.complete, in_order(found.q)


def other_searches() -> Any:
    arm = kinseek.load("cylindrical3")
    T = targets(arm, 1)[0]
    searches: list[Solver] = [
        kinseek.BruteForce(branching_factor=4),
        kinseek.DivideAndConquer(branching_factor=64, divisions=3, breadth=2),
        kinseek.DivideAndConquer(branching_factor=64, beam=3, children=2),
        kinseek.BlindSearch(most_steps=10),
        kinseek.CoordinateDescent(),
    ]
    return [arm.ik(T, solver=each).q for each in searches]


def any_mechanism() -> Any:
    arm = kinseek.Arm.from_fk(kinseek.load("planar2").fk, [-3, -3], [3, 3], kinds="revolute")
    T = kinseek.load("planar2").fk([0.4, 0.9])
    grid = arm.ik(T, solver=kinseek.DivideAndConquer(branching_factor=64, beam=3, children=2))
    return arm.ik(T, solver=Atlas(samples=32)).success, grid.q


def many_poses(name: str) -> Any:
    """Poses in a row: followed forward and backward, brought back onto their targets, and tracked."""
    chain = kinseek.load(name).chain
    index = AtlasIndex(chain, POSE, chain.arrays, 64)
    middle, count = chain.lower + 0.4 * (chain.upper - chain.lower), 5
    q = middle + 0.02 * np.arange(count)[:, None] * np.linspace(1.0, -0.8, chain.dof)
    poses = chain.forward(q)
    targets = np.ascontiguousarray(poses[:, :3])
    near, left = q + 0.01, np.empty(count)
    job, limits = index.job(PLAIN_TOLERANCES), Limits(chain.lower, chain.upper)
    project_onto_poses(job, targets, limits, 8, near, left)
    followed, ends = [], np.zeros(LANES, dtype=np.int64)
    for begin, end in ((0, count - 1), (count - 1, 0)):
        rows = np.zeros((count, LANES, chain.dof))
        rows[begin, :2] = q[begin]
        trace(job, targets, Leg(begin, end, 2), np.full(chain.dof, 0.5), rows, ends)
        followed += [rows[:, :2].copy(), ends.copy()]
        spans, became = np.array([[1, count - 2], [0, count - 1]]), np.zeros(2, dtype=np.int64)
        both = np.stack([rows[:, 0] + 1e-7, rows[:, 0]], axis=1)
        part_ways(both, 1, 1 if end > begin else -1, np.arange(chain.dof) % 2, spans, became)
        followed += [spans, became]
    nothing, reach = np.zeros(chain.dof), np.full(chain.dof, 0.03)
    values = chain.lower, chain.upper, reach, q[0], nothing, nothing, nothing, nothing, 1e-3 * (q[1] - q[0])
    state = State(*(row.copy() for row in values))
    memory = np.zeros(DESK.count.of(dof=chain.dof, joints=len(chain.leader)))
    steps = [
        servo_step(index.address, PLAIN_TOLERANCES, np.ascontiguousarray(T), memory, state)
        for T in (poses[1], poses[-1], 2 * poses[0])
    ]
    ahead = look_ahead(
        index.address, PLAIN_TOLERANCES, np.concatenate([poses, poses[:1] @ poses]), 1e-3, 1e-2, memory, state
    )
    steered = [step[:2] for step in steps[:2]], [step[2] for step in steps], list(ahead), state.now.copy()
    kept = [kept_within(chain, np.array([1.5, 20.0, jerk]), q) for jerk in (300.0, np.inf)]
    kept += [kept_within(chain, np.array([1.5, np.inf, np.inf]), q)]
    state = State(*(row.copy() for row in values))
    given = (
        chain.lower,
        chain.upper,
        *(limit + nothing for limit in (1.5, 20.0, 300.0)),
        q[0],
        *np.zeros((10, chain.dof)),
    )
    joints, free = (
        Motion(*(row.copy() for row in given)),
        Room(np.zeros((0, chain.dof)), np.zeros(0)),
    )
    led = [
        track_step(
            index.address, PLAIN_TOLERANCES, np.ascontiguousarray(T), memory, state, joints, free, 0.01
        )
        for T in (poses[1], 2 * poses[0])
    ]
    tracked = [np.array(step[:2]) for step in led[:1]], [step[2] for step in led], joints.q.copy()
    moved = np.empty((3, 4, 4))
    for one, most in zip(moved, ([1e-3, 1e-2], [9.0, 9.0], [9.0, 9.0]), strict=True):
        turn = np.zeros(6) if most[0] < 1.0 else np.full(6, 0.1)
        move_towards(poses[0], poses[-1], np.array(most), 0.5, turn, one)
    followed.append(moved)
    return near, *followed, *steered, *kept, *tracked


def kept_within(chain: Any, rates: Any, q: Any) -> Any:
    """Joints within limits that follow values, change their velocities, and stop before bodies."""
    n, found = chain.dof, []
    rows = chain.lower, chain.upper, *(limit + np.zeros(n) for limit in rates), q[0], *np.zeros((10, n))
    joints, free = Motion(*(row.copy() for row in rows)), Room(np.zeros((0, n)), np.zeros(0))
    near = Room(np.full((2, n), 0.5), np.array([1.0, 0.02]))
    joints.before[:] = q[0]
    for k in range(24):
        joints.target[:] = q[0] + 0.05 * (1 if k < 12 else -1)
        joints.wanted[:] = 2.0 if k % 3 else -9.0
        room, what = (
            (near, STRAIGHT_WAY if k % 2 else FOLLOW) if k % 4 < 2 else (free, GO if k % 3 else FOLLOW)
        )
        found.append(limited_step(joints, room, 0.01, what, k % 5 > 0))
    joints.q[:] = chain.upper - 1e-3
    joints.wanted[:] = 1.0
    found += [limited_step(joints, free, 0.01, GO, True) for _ in range(4)]
    return np.array(found), joints.q.copy(), joints.velocity.copy()


def spare_layers(name: str) -> Any:
    """Answers that leave joints to spare, followed to the next layer, spread there, and linked."""
    chain = kinseek.load(name).chain
    kind = POSE if chain.dof == 7 else POINTING
    index, n = AtlasIndex(chain, kind, chain.arrays, 64), chain.dof
    middle = chain.lower + 0.4 * (chain.upper - chain.lower)
    q = middle + 0.02 * np.arange(4)[:, None] * np.linspace(1.0, -0.8, n)
    targets, one = np.ascontiguousarray(chain.forward(q)[:, :3]), np.ones(n)
    kinds, job = np.zeros(n, dtype=np.int64), index.job(PLAIN_TOLERANCES)
    turns = Turns(chain.lower, chain.upper, kinds, kinds + 1)
    layers: list[Array] = []
    for row in (0, 3):
        given = np.concatenate([q[row : row + 1], np.full((1, n), 99.0)])
        found, along = np.zeros((2, 3 if n == 7 else 10, n))
        count = spread_solutions(job, targets[row], Given(given, 1, 0.05, 0.1), turns, found, along)
        layers += [found[:count], along[:count]]
    here, _, there, there_along = layers
    ends, moments, leaps = branch_ends(here), np.arange(0.0, 8.0, 2.0), np.full(n, 0.5)
    propagate_layer(job, targets, moments, leaps, one, here, ends)
    nodes = np.zeros(len(here), dtype=np.int64), np.arange(float(len(here))), np.zeros(len(here), np.int64)
    before = Layer(here, ends.along, *nodes)
    nodes = np.zeros(len(there), dtype=np.int64), np.zeros(len(there)), np.zeros(len(there), np.int64)
    after = Layer(there, there_along, *nodes)
    viterbi_step(before, ends, after, turns, Sideways(0.1 * one, 0.4 * one, one, 6.0), np.zeros(0))
    told = np.column_stack([ends.cost, ends.least, ends.most])
    return count, here, there, ends.along, told, after.fault, after.sums, after.came


def best_ways() -> Any:
    """The best way through layers, with copies, refused nodes, barred steps and costs of nodes; and a band of blocks."""
    rng, told, path = np.random.default_rng(2), np.zeros(6), np.zeros(6, dtype=np.int64)
    q = rng.uniform(0.0, 6.0, (6, 3, 3))
    kinds, copies = np.array([STRAIGHT, COPIED, ENDLESS]), np.array([1, 2, 1])
    turns = Turns(np.zeros(3), np.array([6.0, 12.0, 6.0]), kinds, copies)
    found = []
    for mode in (DISTANCE, TIME, SQUARES, GIVEN):
        costs = rng.uniform(size=(6, 6)) if mode == GIVEN else np.zeros((0, 0))
        refused = rng.uniform(size=(6, 6)) < 0.2
        layers, steps = Layers(q, np.full(6, 3)), Steps(np.full((1, 3), 3.0), np.ones(3), mode)
        rules = Rules(costs, refused, np.array([[0, 1, 2], [3, 0, 0]]), np.array([-1, -1]))
        breaks = viterbi(layers, turns, steps, rules, path, told)
        found.append((breaks, path.copy(), told.copy()))
    blocks = np.array([4 * np.eye(2) + 0.1 * k for k in range(4)])
    right = rng.uniform(size=(4, 2))
    solve_band(blocks, np.ones((4, 2)), right)
    return found, right


def motions_in_time() -> Any:
    """A spline through joint values, and the motions along it with limits of accelerations, and of jerks."""
    rng, knots = np.random.default_rng(4), np.linspace(0.0, 1.0, 7)
    q, slopes = np.cumsum(rng.uniform(0.0, 0.1, (7, 2)), axis=0), np.zeros((7, 2))
    spline_slopes(knots, q, slopes)
    inner = 3.0 * np.diff(q, axis=0) / np.diff(knots)[:, None] - slopes[:-1] - slopes[1:]
    rates, widths = np.stack([slopes[:-1], inner, slopes[1:]], axis=-1), np.diff(knots)
    limits, tool = np.array([[2.0] * 2, [10.0] * 2, [100.0] * 2]), np.full((6, 2), 0.1)
    reachable, x, report = np.zeros(7), np.zeros(7), np.zeros(2)
    fastest_profile(rates, widths, limits[0], limits[1], tool, reachable, x)
    smooth = np.full(6, 0.1)
    smooth_profile(rates, widths, limits, tool, 0.1, 2, smooth, report)
    begins, divided = np.zeros((6, 2, 2)), np.zeros((6, 2, 2, 3))
    divide_pieces(q[:-1], rates, widths, begins, divided)
    return slopes, reachable, x, smooth, report, begins, divided


def steps_proved(name: str) -> Any:
    """Of steps of a path what is proved: some calm ones, one through a jump, one beyond a limit."""
    arm = kinseek.load(name)
    rng = np.random.default_rng(3)
    q = rng.uniform(0.4, 0.6, arm.dof) * (arm.upper - arm.lower) + arm.lower
    rows = q + 0.02 * np.arange(5)[:, None] * rng.uniform(-1, 1, arm.dof)
    rows[3] += 0.4
    problem = Problem(arm.chain, Goal.pose(arm.fk(rows)))
    lower, upper = arm.chain.lower.copy(), arm.chain.upper.copy()
    upper[0] = rows[1:3, 0].mean()
    told = [
        prove_rows(problem, rows, np.arange(4), keep=keep, limits=limits)
        for keep, limits in ((True, None), (False, (lower, upper)))
    ]
    return [(each.state, np.minimum(each.within, 1.0)) for each in told]


def first_pass() -> Any:
    """What is free, what touches, and how near pairs are, without the library that is asked about the rest."""
    chain = kinseek.load("elbow6").chain
    shapes = [
        Box((0.1, 0.2, 0.3)),
        Capsule(0.05, 0.3),
        Cylinder(0.05, 0.2),
        Sphere(0.1),
        Box((1.0, 1.0, 0.02)),
    ]
    joints, places = (
        (0, 4, 4, 0, 0),
        ([0.4, 0.2, 0.1], [0, 0, 0.1], [0.1, 0, 0], [-0.4, 0.3, 0.2], [0, 0, 0.6]),
    )
    solids = [
        Solid(joint, shape, kinseek.pose(place, rpy=[joint, 1.0, 0.5]), 0.0)
        for joint, shape, place in zip(joints, shapes, places, strict=True)
    ]
    pairs = [(i, j) for i, j in combinations(range(len(solids)), 2) if solids[i].joint != solids[j].joint]
    broad = Broad(chain, solids, pairs, np.full(len(pairs), 0.001))
    q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (9, chain.dof))
    verdicts, doubts = broad.sort_out(q, 0.0, 1e-6)
    levers, least = np.full((1, len(pairs), chain.dof), 1.5), np.full((9, len(pairs)), 1e-5)
    motions = broad.free_motions(q, 0.01 * (q[::-1] - q), levers, least)
    samples = broad.free_samples(q, q[::-1] - q, np.full(9, 10), 0.0, 1e-6)
    return verdicts, doubts, broad.bounds(q), broad.bounds(q, 12), motions, samples


RUNS: list[tuple[Any, ...]] = [
    *[(spare_layers, name) for name in ("panda", "elbow6")],
    *[(one, name) for name in ("planar2", "cylindrical3", "scara4", "elbow6", "jaco2_6", "ur10e_rail")],
    *[(batch, name) for name in ("planar2", "scara4", "elbow6", "ur10e_calibrated", "gen3")],
    *[(near, name) for name in ("cylindrical3", "scara4", "ur5e")],
    # farther away than the arm is long, and nearer by.
    *[(out_of_reach, name, 2.5) for name in ("planar2", "elbow6")],
    *[(out_of_reach, name, times) for name, times in (("cylindrical3", 1.8), ("elbow6", 1.4))],
    *[(swept_branches, name) for name in ("panda", "ur10e_rail")],
    *[(gates, name) for name in ("cylindrical3", "elbow6")],
    *[(asked, name) for name in ("ur5e", "irb120", "panda")],
    *[(around, name) for name in ("ur5e", "panda")],
    (positions_and_directions, "elbow6"),
    (box, "elbow6"),
    (motions_in_time,),
    (plain_calls,),
    *[(branches, name) for name in ("planar2", "elbow6", "ur5e", "jaco2_6")],
    (nearly_branches,),
    (free_branches,),
    *[(all_branches, arm) for arm in (TWO, SLIDES)],
    (on_a_ball, "panda", 1.3),
    (proof, SLIDES, "pose", None, 30),
    (proof, TWO, "pose", 0.05, 100),
    (proof, SLIDES, "position", 0.2, 60),
    (proof, SLIDES, "pointing", 0.2, 20),
    (bounds, kinseek.load("elbow6"), "pose", 12),
    (bounds, kinseek.load("cylindrical3"), "pose", 40),
    (bounds, kinseek.load("cylindrical3"), "pointing", 40),
    (bounds, kinseek.load("elbow6"), "cone", 12),
    (bounds, TWO, "pose", 60),
    (reachable_proof,),
    (isolated, SLIDES, 100),
    (isolated, TWO, 200),
    (other_searches,),
    (any_mechanism,),
    (many_poses, "elbow6"),
    (best_ways,),
    (steps_proved, "elbow6"),
    (steps_proved, "ur10e_rail"),
    (first_pass,),
]
CASES: dict[str, Callable[[], Any]] = {
    " ".join(
        [function.__name__, *(each.name if isinstance(each, kinseek.Arm) else str(each) for each in given)]
    ): partial(function, *given)
    for function, *given in RUNS
}


def few_samples() -> None:
    """Branches shall make do with small atlases too."""
    whole = vars(branching)["atlas_of"]
    vars(branching).update(SAMPLES=64, atlas_of=lambda chain, goal: whole(chain, goal, 64))


@pytest.fixture(name="compiled", scope="module")
def _compiled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What machine code answers in all the cases."""
    to = tmp_path_factory.mktemp("compiled") / "answers"
    environment = {name: value for name, value in os.environ.items() if name != "NUMBA_DISABLE_JIT"}
    answers: dict[str, Any] = {}
    for more in ({}, {"KINSEEK_JIT": "1"}):  # The library has no entry for the kernel of `bounds`.
        names = [name for name in CASES if name.startswith("bounds ") == bool(more)]
        subprocess.run([sys.executable, __file__, str(to), *names], env=environment | more, check=True)
        answers |= pickle.loads(to.read_bytes())
    return answers


plainly = pytest.mark.skipif(not PLAIN, reason="for NUMBA_DISABLE_JIT=1, see the top of the file")


@plainly
@pytest.mark.parametrize("name", CASES)
def test_the_same_answers_as_compiled(
    name: str, compiled: dict[str, Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    for changed in ("SAMPLES", "atlas_of"):
        monkeypatch.setitem(vars(branching), changed, vars(branching)[changed])
    few_samples()
    agree(CASES[name](), compiled[name])


def agree(plain: Any, compiled: Any) -> None:
    if isinstance(plain, tuple | list):
        assert len(plain) == len(compiled)
        for each, other in zip(plain, compiled, strict=True):
            agree(each, other)
    elif np.asarray(plain).dtype.kind == "f":
        np.testing.assert_allclose(plain, compiled, atol=1e-6)
    else:
        np.testing.assert_array_equal(plain, compiled)


@plainly
def test_a_routine_is_called_by_its_number() -> None:
    from kinseek.kernels.atlas.one_goal import routines

    numbers = routines()
    with pytest.raises(TypeError, match="iterate_routine: job must be a Job, got 1"):
        call_at(numbers[0], (1, 2))


def test_indices_that_machine_code_would_follow_anywhere_are_refused() -> None:
    memory = np.arange(12.0)
    view: Any = view_of("f")(memory.ctypes.data + 16, (2, 4))
    np.testing.assert_array_equal(unbounded(view), memory[2:10].reshape(2, 4))
    for key in (2, -1, (0, 4), (0, -1), np.int64(-2), slice(0, 3), slice(-1, None), (0, slice(2, 5))):
        with pytest.raises(IndexError):
            view[key]
        with pytest.raises(IndexError):
            view[key] = 1.0
    view[1, 1:3] = 7.0
    assert memory.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 7, 9, 10, 11]
    assert isinstance(bounded((memory, 1))[0][:4], Bounded)
    assert type(unbounded(bounded((memory, 1)))[0]) is np.ndarray


if __name__ == "__main__":
    few_samples()
    Path(sys.argv[1]).write_bytes(pickle.dumps({name: CASES[name]() for name in sys.argv[2:]}))
