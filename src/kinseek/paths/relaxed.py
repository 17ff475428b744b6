"""Free axes and ranges as joints of the arm: a goal that leaves some freedom is a pose for an arm with more joints.

Let T = T_goal · Trans(d) · Rot(w) with d and w in their ranges be wanted of the hand. Then T · Rot(-w) · Trans(-d) = T_goal
is a plain pose for the arm with joints at its tip that turn by -w and slide by -d, and whose limits are the ranges. Slides
along the axes of the base stand before the arm instead.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kinds import POINTING, POSE, POSITION
from kinseek.problem import Problem
from kinseek.ranges import AXES, FREE_TURN, PINNED
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from kinseek.robots.variants import with_tool
from kinseek.transforms import rotation_onto, square

from .asked import Asked

Array = NDArray[np.float64]

LIGHT = 0.02
"""Weight of a joint that stands for a free axis, beside 1 of a joint of the arm: it moves for nothing, but smoothly."""


def relaxed(asked: Asked) -> tuple[Asked, slice]:
    """The same path for an arm with a joint for each range, and which of its joints are those of the arm.

    Raises:
        InvalidProblem: Ranges of several rotations.
    """
    goal, chain = asked.problem.goal, asked.problem.chain
    if goal.ranges is None:
        return asked, slice(None)
    turns = [i for i in range(3, 6) if goal.ranges[i] != PINNED]
    slides = [i for i in range(3) if goal.ranges[i] != PINNED]
    free = [i for i in turns if goal.ranges[i] == FREE_TURN]
    any_turn = len(free) == 3
    if not any_turn and goal.swing is None and (len(turns) > 1 or (turns and goal.frame == "base")):
        raise InvalidProblem(
            f"a path takes a range about one axis of the tool, or all three free; this goal has ranges about "
            f"{', '.join(AXES[i] for i in turns)} of the {goal.frame}"
        )
    if goal.tool is not None:
        chain = with_tool(chain, square(goal.tool[:3]))
    reach = 2 * chain.reach + float(np.linalg.norm(goal.targets[:, :, 3], axis=1).max(initial=0.0))
    first, axes = 0, _frame_axes(goal)
    if goal.swing is None and turns and not any_turn:
        low, high = goal.ranges[turns[0]]
        chain = _at_tip(chain, np.eye(3)[turns[0] - 3], AXES[turns[0]], -high, -low, REVOLUTE)
    for i in slides:
        low, high = (float(np.clip(end, -reach, reach)) for end in goal.ranges[i])
        if goal.frame == "tool":
            chain = _at_tip(chain, np.eye(3)[i], AXES[i], -high, -low, PRISMATIC)
        else:
            chain = _at_base(chain, axes[:, i], AXES[i], -high, -low)
            first += 1
    targets = np.array([square(row) for row in goal.targets])
    plain = replace(goal, target=targets, kind=POSE.name, ranges=None, swing=None, tool=None, base=None)
    if any_turn:
        plain = replace(plain, kind=POSITION.name)
    elif goal.swing is not None:
        plain = _swinging(goal, plain, targets)
    more = chain.dof - asked.problem.chain.dof
    own = slice(first, first + asked.problem.chain.dof)
    longest = np.full((len(asked.longest), chain.dof), np.inf)
    longest[:, own] = asked.longest
    weights = np.full(chain.dof, LIGHT)
    weights[own] = asked.weights
    if more and (asked.start is not None or asked.end is not None):
        raise InvalidProblem(
            "start= and end= are not taken yet where the goal has ranges; a pose, direction or place takes them"
        )
    velocity = asked.velocity
    if velocity is not None:
        velocity = np.full(chain.dof, velocity.max())
        velocity[own] = asked.velocity
    valid = None if asked.valid is None else replace(asked.valid, own=own)
    part = replace(
        asked, problem=Problem(chain, plain), longest=longest, weights=weights, velocity=velocity, valid=valid
    )
    return part, own


def _frame_axes(goal: Goal) -> Array:
    return np.eye(3) if goal.base is None else goal.base[:3, :3].T


def _swinging(goal: Goal, plain: Goal, targets: Array) -> Goal:
    """A direction instead of a turn that is free about one axis."""
    assert goal.swing is not None
    axis = np.array(goal.swing)
    if goal.frame == "tool":
        return replace(plain, kind=POINTING.name, tool_axis=goal.swing)
    # The axis is fixed in the base: of the tool it is where the target has it.
    along = _frame_axes(goal) @ axis
    own = np.einsum("kji,j->ki", targets[:, :3, :3], along)
    if np.abs(own - own[0]).max(initial=0.0) > 1e-9:
        targets = targets.copy()
        for i in range(len(targets)):
            targets[i, :3, :3] = rotation_onto(own[0], along)
    x, y, z = own[0]
    return replace(plain, target=targets, kind=POINTING.name, tool_axis=(float(x), float(y), float(z)))


def _at_tip(chain: SerialChain, axis: Array, name: str, lower: float, upper: float, kind: str) -> SerialChain:
    """The chain with one more joint about or along an axis of its tip."""
    turn = np.zeros((3, 4))
    turn[:, :3] = rotation_onto(np.array([0.0, 0.0, 1.0]), axis)
    back = np.zeros((3, 4))
    back[:, :3] = turn[:, :3].T
    fixed = np.concatenate([chain.fixed[:-1], _product(chain.fixed[-1], turn)[None], back[None]])
    if kind == REVOLUTE and upper - lower >= 2 * np.pi - 1e-9:
        kind, lower, upper = CONTINUOUS, -np.pi, np.pi
    return _more(chain, fixed, name, lower, upper, kind, chain.dof, len(chain.leader))


def _at_base(chain: SerialChain, axis: Array, name: str, lower: float, upper: float) -> SerialChain:
    """The chain on a slide along an axis of its base."""
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
    """Put a variable before variable `at`, with its physical joint before joint `place`."""
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
