"""Variants of an arm: with locked joints, with narrower limits, or with a tool at its tip."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot, suggest
from kinseek.transforms import rotation, square, transform
from kinseek.turns import TURN

from .chain import Frame, SerialChain
from .mechanism import CONTINUOUS, REVOLUTE, Mechanism

Array = NDArray[np.float64]


def with_locked(chain: SerialChain, values: Mapping[str, float]) -> SerialChain:
    """Lock joints: each of their physical joints, mimic joints included, becomes part of a fixed transform.

    Args:
        chain: The arm.
        values: Value of each joint to lock, by name, [rad] or [m].

    Raises:
        InvalidRobot: A joint is unknown, a value is invalid or outside the limits, or every joint would be locked.
    """
    locked: dict[int, float] = {}
    for name, value in _named(chain, values, "value"):
        i = chain.joint_names.index(name)
        number = _number(value, f"the value of locked joint {name!r}")
        if chain.kinds[i] != CONTINUOUS and not chain.lower[i] <= number <= chain.upper[i]:
            raise InvalidRobot(
                f"joint {name!r} cannot be locked at {number:g}: its limits are "
                f"[{chain.lower[i]:g}, {chain.upper[i]:g}]"
            )
        locked[i] = number
    if not locked:
        return replace(chain)
    left = [i for i in range(chain.dof) if i not in locked]
    if not left:
        raise InvalidRobot(f"{chain.name}: every joint is locked; at least one joint must be able to move")

    fixed: list[Array] = []
    moving: list[int] = []
    pending = np.eye(4)
    ends = [Frame(0, pending)]
    """For each physical joint of the arm: the number of kept joints up to it, and the transform since the last of them."""
    for k, i in enumerate(chain.leader):
        # Transforms of locked joints are collected until the next joint that moves.
        pending = pending @ square(chain.fixed[k])
        if i in locked:
            pending = pending @ _moved(
                bool(chain.prismatic[k]), chain.multiplier[k] * locked[i] + chain.offset[k]
            )
            ends.append(Frame(len(moving), pending))
            continue
        fixed.append(pending[:3])
        moving.append(k)
        pending = np.eye(4)
        ends.append(Frame(len(moving), pending))
    fixed.append((pending @ square(chain.fixed[-1]))[:3])
    return replace(
        chain,
        joint_names=tuple(chain.joint_names[i] for i in left),
        kinds=tuple(chain.kinds[i] for i in left),
        lower=chain.lower[left],
        upper=chain.upper[left],
        velocity=chain.velocity[left],
        fixed=np.array(fixed),
        prismatic=chain.prismatic[moving],
        leader=np.array([left.index(i) for i in chain.leader[moving]], dtype=np.int64),
        multiplier=chain.multiplier[moving],
        offset=chain.offset[moving],
        frames={
            name: Frame(ends[frame.joints].joints, ends[frame.joints].pose @ frame.pose)
            for name, frame in chain.frames.items()
        },
        locked=(*chain.locked, *((chain.joint_names[i], value) for i, value in locked.items())),
    )


def with_limits(chain: Mechanism, limits: Mapping[str, tuple[float, float]]) -> Mechanism:
    """Narrow the limits of joints; a continuous joint with limits becomes a revolute one.

    Args:
        chain: The arm.
        limits: Lower and upper limit of each joint to narrow, by name, [rad] or [m].

    Raises:
        InvalidRobot: A joint is unknown, or limits are invalid, inverted, or wider than those of the arm; for a continuous
            joint, wider than a full turn.
    """
    lower, upper, kinds = chain.lower.copy(), chain.upper.copy(), list(chain.kinds)
    for name, pair in _named(chain, limits, "limits (lower, upper)"):
        i = chain.joint_names.index(name)
        try:
            low, high = (_number(end, f"a limit of joint {name!r}") for end in pair)
        except (TypeError, ValueError, OverflowError) as error:
            if isinstance(error, InvalidRobot):
                raise
            raise InvalidRobot(
                f"limits of joint {name!r} must be a pair (lower, upper), got {pair!r}"
            ) from None
        if low > high:
            raise InvalidRobot(f"joint {name!r}: lower limit {low:g} is above upper limit {high:g}")
        # Such limits would admit several turns of a joint that is defined modulo one turn.
        if kinds[i] == CONTINUOUS and high - low > TURN:
            raise InvalidRobot(
                f"joint {name!r} is continuous, so limits [{low:g}, {high:g}] wider than a full turn have no effect"
            )
        if kinds[i] != CONTINUOUS and not chain.lower[i] <= low <= high <= chain.upper[i]:
            raise InvalidRobot(
                f"joint {name!r}: limits [{low:g}, {high:g}] are wider than those of the arm, "
                f"[{chain.lower[i]:g}, {chain.upper[i]:g}]"
            )
        lower[i], upper[i] = low, high
        kinds[i] = REVOLUTE if kinds[i] == CONTINUOUS else kinds[i]
    return chain.limited(lower, upper, tuple(kinds))


def with_tool(chain: SerialChain, tool: Array) -> SerialChain:
    """Move the tip: ``A_tip`` becomes ``A_tip · tool``, where tool, (4, 4), is a rigid transform, lengths in [m].

    The link at the tip keeps its pose; only the frame of `fk` and goals moves.
    """
    fixed = chain.fixed.copy()
    fixed[-1] = (square(fixed[-1]) @ tool)[:3]
    return replace(chain, fixed=fixed, tooled=True)


def _named(chain: Mechanism, given: Any, noun: str) -> list[tuple[str, Any]]:
    if not isinstance(given, Mapping):
        raise InvalidRobot(f"expected a mapping from joint names to {noun}, got {given!r}")
    for name in given:
        if name not in chain.joint_names:
            raise InvalidRobot(suggest(str(name), chain.joint_names, "joint"))
    return list(given.items())


def _number(value: Any, what: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise InvalidRobot(f"{what} must be a finite number, got {value!r}")
    return number


def _moved(prismatic: bool, value: float) -> Array:
    if prismatic:
        return transform(np.eye(3), [0.0, 0.0, value])
    return transform(rotation(np.array([0.0, 0.0, 1.0]), value), [0.0, 0.0, 0.0])
