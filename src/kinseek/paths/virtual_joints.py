"""Free axes and ranges as virtual joints: a goal with freedom is a plain pose for an arm with more joints.

Let T = T_goal · Trans(d) · Rot(w) be the allowed poses of the hand, with d and w in their ranges. Then T · Rot(-w) ·
Trans(-d) = T_goal is a plain pose for an arm with additional joints at its tip. These turn by -w and slide by -d, and their
limits are the ranges. Slides along the axes of the base are placed at the base of the arm instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.order import Cost
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arrays import Limits
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.paths.projection import project_onto_poses
from kinseek.kinds import POINTING, POSE, POSITION
from kinseek.problem import Problem
from kinseek.ranges import AXES, FREE_TURN, PINNED
from kinseek.robots.chain import SerialChain, with_tool
from kinseek.robots.mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from kinseek.solvers.atlas.index import atlas_of, tolerances_of
from kinseek.support.transforms import rotation_onto, rotation_vectors, rotations, square

from .joints import Turning
from .request import PathRequest
from .smooth import MEND

Array = NDArray[np.float64]

LEAST_SHARE = 0.25
"""Least fraction that remains of ranges about three axes. Not examined further."""

LIGHT = 0.02
"""Weight of a joint that stands for a free axis, relative to 1 for a joint of the arm: it moves at almost no cost, but
smoothly. Not examined further."""


def with_virtual_joints(request: PathRequest) -> tuple[PathRequest, slice]:
    """Return the same path for an arm with a joint for each range, and the slice of its own joints.

    Raises:
        InvalidProblem: Ranges of several rotations, or along and about axes that change from pose to pose.
    """
    goal, chain = request.problem.goal, request.problem.chain
    if goal.ranges is None:
        return request, slice(None)
    turns = [i for i in range(3, 6) if goal.ranges[i] != PINNED]
    slides = [i for i in range(3) if goal.ranges[i] != PINNED]
    any_turn = [goal.ranges[i] for i in turns] == [FREE_TURN] * 3
    angles = {} if any_turn else _angles({i: goal.ranges[i] for i in turns}, goal.frame)
    if goal.tool is not None:
        chain = with_tool(chain, square(goal.tool[:3]))
    targets = np.array([square(row) for row in goal.targets])
    plain = replace(goal, target=targets, kind=POSE.name, ranges=None, swing=None, tool=None, base=None)
    first, axes = 0, _frame_axes(goal)
    # A slide at the tip comes after every turn of the hand, so that turn has to be a joint as well.
    tip_slides = goal.frame == "tool" and not any_turn
    if any_turn:
        plain = replace(plain, kind=POSITION.name)
        if goal.frame == "tool" and slides:
            axes = np.stack(
                [_constant(targets[:, :3, k], AXES[k], "along", "in the base") for k in range(3)], axis=1
            )
    elif goal.swing is not None and not (tip_slides and slides):
        plain = _swinging(goal, plain, targets)
    else:
        for turn, (low, high) in angles.items():
            axis = np.eye(3)[turn - 3]
            if goal.frame == "base":
                own = np.einsum("kji,j->ki", targets[:, :3, :3], axes @ axis)
                axis = _constant(own, AXES[turn], "about", "in the tool")
            chain = _at_tip(chain, axis, AXES[turn], -high, -low, REVOLUTE)
    reach = 2 * chain.reach + float(np.linalg.norm(goal.targets[:, :, 3], axis=1).max(initial=0.0))
    for i in slides:
        low, high = (float(np.clip(end, -reach, reach)) for end in goal.ranges[i])
        if tip_slides:
            chain = _at_tip(chain, np.eye(3)[i], AXES[i], -high, -low, PRISMATIC)
        else:
            chain = _at_base(chain, axes[:, i], AXES[i], -high, -low)
            first += 1
    own = slice(first, first + request.problem.chain.dof)
    longest = np.full((len(request.longest), chain.dof), np.inf)
    longest[:, own] = request.longest
    weights = np.full(chain.dof, LIGHT)
    weights[own] = request.weights
    velocity = request.velocity
    if velocity is not None:
        velocity = np.full(chain.dof, velocity.max())
        velocity[own] = request.velocity
    problem = Problem(chain, plain)
    start, end = (
        None if q is None else _with_ranges(problem, own, q, i)
        for q, i in ((request.start, 0), (request.end, -1))
    )
    valid, cost = request.valid, request.cost
    if valid is not None:
        valid = replace(valid, own=own)
    tolerances = None if cost is None else _of_the_arm(cost, own)
    part = replace(
        request,
        problem=problem,
        longest=longest,
        weights=weights,
        velocity=velocity,
        start=start,
        end=end,
        valid=valid,
        cost=tolerances,
    )
    return part, own


def _of_the_arm(cost: Cost, own: slice) -> Cost:
    """Return the user's cost as a function of all joints that only uses the joints of the arm."""
    return lambda q: cost(q[:, own])


def _angles(ranges: dict[int, tuple[float, float]], frame: str) -> dict[int, tuple[float, float]]:
    """Return ranges of angles of consecutive joints for ranges of the components of a rotation vector.

    The joint with the widest range is the last. For three axes the ranges are narrowed, except that of a free turn, until no
    point of a grid leaves the ranges of the vector. So every motion of the joints is allowed, but some allowed rotations
    cannot be reached. The path is evaluated with the goal itself in any case.

    Raises:
        InvalidProblem: Two axes have ranges and the third has none, or too little is left of the ranges.
    """
    if len(ranges) < 2:
        return ranges
    axes = f"about {', '.join(AXES[i] for i in ranges)} of the {frame}"
    if len(ranges) == 2:
        raise InvalidProblem(
            f"a path supports ranges about one axis or about all three; this goal has ranges {axes} and none about "
            "the third: give the third axis a range, or make it free"
        )
    order = sorted(ranges, key=lambda i: ranges[i][1] - ranges[i][0])
    low, high = np.array([ranges[i] for i in order]).T
    grid = np.stack(np.meshgrid(*[np.linspace(0, 1, 9)] * 2, np.linspace(0, 1, 33)), axis=-1).reshape(-1, 3)
    for share in np.linspace(1, LEAST_SHARE, 76):
        part = np.array([share, share, 1.0 if ranges[order[2]] == FREE_TURN else share])
        first, last = part * low, part * high
        w = [np.eye(3)[i - 3] * (first[k] + grid[:, [k]] * (last[k] - first[k])) for k, i in enumerate(order)]
        # The deviation is the last turn, then the second, then the first.
        vector = rotation_vectors(rotations(w[2]) @ rotations(w[1]) @ rotations(w[0]))[
            :, [i - 3 for i in order]
        ]
        if ((vector >= low - 1e-9) & (vector <= high + 1e-9)).all():
            return {i: (float(a), float(b)) for i, a, b in zip(order, first, last, strict=True)}
    raise InvalidProblem(
        f"the ranges {axes} cannot be turned into ranges of angles: give ranges on both sides of 0, or smaller ones"
    )


def _with_ranges(problem: Problem, own: slice, q: Array, i: int) -> Array:
    """Add the values of the virtual joints for target i to joint values of the arm, (m,) -> (n,)."""
    chain, turning = problem.chain, Turning(problem.chain)
    lower, upper = turning.open_lower.copy(), turning.open_upper.copy()
    lower[own] = upper[own] = q
    starts = chain.lower + np.linspace(0, 1, LANES)[:, None] * (chain.upper - chain.lower)
    starts[:, own] = q
    targets, left = np.repeat(problem.goal.targets[i][None], LANES, axis=0), np.empty(LANES)
    job = atlas_of(chain, problem.goal).job(tolerances_of(problem.goal))
    # The arm's own joints are fixed by equal lower and upper limits.
    project_onto_poses(job, targets, Limits(lower, upper), MEND, starts, left)
    return np.asarray(starts[np.argmin(left)])


def _constant(axes: Array, name: str, way: str, where: str) -> Array:
    """Return an axis that all poses of a path share, (k, 3) -> (3,).

    Raises:
        InvalidProblem: It changes.
    """
    if np.abs(axes - axes[0]).max() > 1e-9:
        raise InvalidProblem(
            f"this range {way} {name} needs an axis {where} that is the same at all poses, but it changes. Give the "
            "range in the other frame"
        )
    return np.asarray(axes[0])


def _frame_axes(goal: Goal) -> Array:
    return np.eye(3) if goal.base is None else goal.base[:3, :3].T


def _swinging(goal: Goal, plain: Goal, targets: Array) -> Goal:
    """Return a goal for a direction that replaces a goal with a free turn about one axis."""
    assert goal.swing is not None
    axis = np.array(goal.swing)
    if goal.frame == "tool":
        return replace(plain, kind=POINTING.name, tool_axis=goal.swing)
    # The axis is fixed in the base; in the tool frame it is where the target has it.
    along = _frame_axes(goal) @ axis
    own = np.einsum("kji,j->ki", targets[:, :3, :3], along)
    if np.abs(own - own[0]).max(initial=0.0) > 1e-9:
        targets = targets.copy()
        for i in range(len(targets)):
            targets[i, :3, :3] = rotation_onto(own[0], along)
    x, y, z = own[0]
    return replace(plain, target=targets, kind=POINTING.name, tool_axis=(float(x), float(y), float(z)))


def _at_tip(chain: SerialChain, axis: Array, name: str, lower: float, upper: float, kind: str) -> SerialChain:
    """Return the chain with one more joint about or along an axis of its tip."""
    turn = np.zeros((3, 4))
    turn[:, :3] = rotation_onto(np.array([0.0, 0.0, 1.0]), axis)
    back = np.zeros((3, 4))
    back[:, :3] = turn[:, :3].T
    fixed = np.concatenate([chain.fixed[:-1], _product(chain.fixed[-1], turn)[None], back[None]])
    if kind == REVOLUTE and upper - lower >= 2 * np.pi - 1e-9:
        kind, lower, upper = CONTINUOUS, -np.pi, np.pi
    return _more(chain, fixed, name, lower, upper, kind, chain.dof, len(chain.leader))


def _at_base(chain: SerialChain, axis: Array, name: str, lower: float, upper: float) -> SerialChain:
    """Return the chain on a slide along an axis of its base."""
    turn = np.zeros((3, 4))
    turn[:, :3] = rotation_onto(np.array([0.0, 0.0, 1.0]), axis)
    back = np.zeros((3, 4))
    back[:, :3] = turn[:, :3].T
    fixed = np.concatenate([turn[None], _product(back, chain.fixed[0])[None], chain.fixed[1:]])
    return _more(chain, fixed, name, lower, upper, PRISMATIC, 0, 0)


def _product(A: Array, B: Array) -> Array:
    return (square(A) @ square(B))[:3]


def _more(
    chain: SerialChain, fixed: Array, name: str, lower: float, upper: float, kind: str, at: int, place: int
) -> SerialChain:
    """Insert a variable before variable `at`, with its physical joint before joint `place`."""
    leader = np.where(chain.leader >= at, chain.leader + 1, chain.leader)
    return replace(
        chain,
        joint_names=(*chain.joint_names[:at], f"goal {name}", *chain.joint_names[at:]),
        kinds=(*chain.kinds[:at], kind, *chain.kinds[at:]),
        lower=np.insert(chain.lower, at, lower),
        upper=np.insert(chain.upper, at, upper),
        fixed=np.ascontiguousarray(fixed),
        prismatic=np.insert(chain.prismatic, place, kind == PRISMATIC),
        leader=np.insert(leader, place, at),
        multiplier=np.insert(chain.multiplier, place, 1.0),
        offset=np.insert(chain.offset, place, 0.0),
        velocity=np.insert(chain.velocity, at, np.nan),
        frames={},
    )
