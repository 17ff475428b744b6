"""Postures by name: shoulder, elbow and wrist of arms with a closed form, the arm angle of seven joints, and full turns.

They are read from joint values (`Solution.configuration`) and requested by the same names (``prefer=`` of `Arm.ik`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidProblem, InvalidUse, suggest
from .robots.chain import SerialChain
from .robots.mechanism import Mechanism, no_axes
from .structure.arm_angle import ArmAngle, arm_angle_of
from .structure.signs import UNDECIDED, Signs, signs_of
from .structure.structure import structure_of
from .support.caching import WeakCache
from .support.turns import TURN, shortest

Array = NDArray[np.float64]

NAMES = {"shoulder": ("front", "back"), "elbow": ("up", "down"), "wrist": ("noflip", "flip")}
"""The words for a number of `Signs.values` that is at least 0, and for a negative one."""

ARM_ANGLE, TURNS = "arm_angle", "turns"


@dataclass(frozen=True)
class Postures:
    """What can be read from the joint values of an arm and requested of them."""

    signs: Signs | None
    arm_angle: ArmAngle | None
    turning: dict[str, int]
    """Index of each joint that can turn more than once, by name."""

    @property
    def keys(self) -> tuple[str, ...]:
        """The names."""
        names = tuple(NAMES) if self.signs is not None else (ARM_ANGLE,)
        return (*names, TURNS) if self.turning else names

    def of(self, q: Array) -> dict[str, Any]:
        """Return the posture of joint values, (..., n); see `Solution.configuration`."""
        rows, found = q.reshape(-1, q.shape[-1]), dict[str, Any]()

        def shaped(column: NDArray[Any]) -> Any:
            return column.reshape(q.shape[:-1]) if q.ndim > 1 else column[0].item()

        if self.signs is not None:
            for (name, (one, other)), values in zip(NAMES.items(), self.signs.values(rows).T, strict=True):
                words = np.where(values >= -UNDECIDED, one, other)
                found[name] = shaped(np.where(np.isnan(values), "", words))
        elif self.arm_angle is not None:
            found[ARM_ANGLE] = shaped(self.arm_angle.angles(rows))
        if self.turning:
            found[TURNS] = {
                name: shaped(turns_of(np.nan_to_num(rows[:, i]))) for name, i in self.turning.items()
            }
        return found


def turns_of(angles: Array) -> NDArray[np.int64]:
    """Return the number of full turns by which each angle is outside (-π, π] [rad]."""
    return np.ceil((angles - math.pi) / TURN).astype(np.int64)


@dataclass(frozen=True)
class PostureRequest:
    """A requested posture."""

    postures: Postures
    signs: dict[int, float]
    """Wanted sign, 1 or -1, of each requested number of `Signs.values`."""
    turns: dict[int, int]
    """Wanted full turns of each requested joint."""
    arm_angle: float | None

    def mismatches(self, q: Array) -> NDArray[np.int64]:
        """Return how many of the requested names each of some joint values does not have, (k, n) -> (k,)."""
        mismatched = np.zeros(len(q), dtype=np.int64)
        if self.signs and self.postures.signs is not None:
            values = self.postures.signs.values(q)
            for i, sign in self.signs.items():
                # On the border between two names a posture has both.
                mismatched += sign * values[:, i] < -UNDECIDED
        for i, turns in self.turns.items():
            mismatched += turns_of(q[:, i]) != turns
        return mismatched

    def angle_errors(self, q: Array) -> tuple[Array, Array]:
        """Return how far some joint values, (k, 7), are from the arm angle, (k,) [rad], and its derivatives, (k, 7)."""
        assert self.postures.arm_angle is not None
        assert self.arm_angle is not None
        angles, gradients = self.postures.arm_angle.with_gradients(q)
        return shortest(self.arm_angle - angles), gradients


_known: WeakCache[SerialChain, None, Postures] = WeakCache()


def configuration_of(mechanism: Mechanism, q: Array) -> dict[str, Any]:
    """Return the posture of joint values, (..., n); see `Solution.configuration`.

    Raises:
        InvalidUse: Postures of this arm have no names.
    """
    found = _postures_of(mechanism)
    if isinstance(found, str):
        raise InvalidUse(found)
    return found.of(q)


def read_posture(mechanism: Mechanism, given: Mapping[str, Any]) -> PostureRequest:
    """Read a requested posture.

    Raises:
        InvalidProblem: Postures of this arm have no names, or an unknown name or value.
    """
    found = _postures_of(mechanism)
    if isinstance(found, str):
        raise InvalidProblem(found)
    if not given:
        raise InvalidProblem(f"prefer={{}} requests no posture; valid names: {', '.join(found.keys)}")
    signs: dict[int, float] = {}
    turns: dict[int, int] = {}
    arm_angle = None
    for name, value in given.items():
        if name not in found.keys:
            raise InvalidProblem(suggest(str(name), found.keys, f"posture of {mechanism.name!r}"))
        if name == ARM_ANGLE:
            arm_angle = _angle(value)
        elif name == TURNS:
            turns = _turns(found, value)
        elif isinstance(value, str) and value in NAMES[name]:
            signs[list(NAMES).index(name)] = 1.0 if value == NAMES[name][0] else -1.0
        else:
            raise InvalidProblem(suggest(str(value), NAMES[name], f"value of {name!r}"))
    return PostureRequest(found, signs, turns, arm_angle)


def _angle(value: Any) -> float:
    try:
        angle = float(value)
    except (TypeError, ValueError, OverflowError):
        angle = math.nan
    if not math.isfinite(angle) or isinstance(value, bool | str):
        raise InvalidProblem(f"prefer={{'arm_angle': …}} must be one finite angle [rad], got {value!r}")
    return angle


def _turns(found: Postures, value: Any) -> dict[int, int]:
    if not isinstance(value, Mapping):
        example = {next(iter(found.turning)): 0}
        raise InvalidProblem(
            f"prefer={{'turns': …}} must map joints to whole numbers, such as {example}, got {value!r}"
        )
    turns = {}
    for joint, number in value.items():
        if joint not in found.turning:
            raise InvalidProblem(suggest(str(joint), found.turning, "joint that can turn more than once"))
        if isinstance(number, bool) or not isinstance(number, int | np.integer):
            raise InvalidProblem(f"the turns of joint {joint!r} must be a whole number, got {number!r}")
        turns[found.turning[joint]] = int(number)
    return turns


def _postures_of(mechanism: Mechanism) -> Postures | str:
    """Return the names of an arm's postures, or why it has none."""
    chain = mechanism.axes
    if chain is None:
        return no_axes(mechanism, "a posture is named by where axes are")
    found = _known.of(chain).get(None, lambda: _find(chain))
    if found.signs is not None or found.arm_angle is not None:
        return found
    return (
        f"postures of {mechanism.name!r} have no names. They have for arms with six revolute joints and a closed form that "
        "begins at the base (a spherical wrist, or three parallel axes), and for seven revolute joints; got "
        f"{', '.join(dict.fromkeys(chain.kinds))} joints, {chain.dof} in number: {_structure(chain).sentence}"
    )


def _structure(chain: SerialChain) -> Any:
    return structure_of(chain.arrays, chain.length)


def _find(chain: SerialChain) -> Postures:
    wide = chain.upper - chain.lower > TURN + 1e-9
    more = np.flatnonzero(wide & chain.turns & chain.periodic & ~chain.endless)
    return Postures(
        signs=signs_of(chain.arrays, _structure(chain)),
        arm_angle=arm_angle_of(chain.arrays),
        turning={chain.joint_names[i]: int(i) for i in more},
    )
