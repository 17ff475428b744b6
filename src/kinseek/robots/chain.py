"""The serial chain that every reader returns and every kernel takes, and its variants: locked joints, limits and tools.

``T_base_tip(q) = A_1 J_1 A_2 J_2 … A_m J_m A_tip``: each ``A_k`` is fixed, and each ``J_k`` is a rotation about, or a
translation along, its own z axis. So kernels need no case distinction for axes. A mimic joint is one more ``J_k`` driven by
the same variable: ``J_k = J(multiplier · q[leader] + offset)``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidRobot, suggest
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import ChainArrays, chain_arrays
from kinseek.support.interrupts import in_chunks
from kinseek.support.lazy import lazy
from kinseek.support.transforms import rotation, square, transform
from kinseek.support.turns import TURN
from kinseek.support.units import warn_of_rates
from kinseek.support.validation import as_float_array

from .mechanism import CONTINUOUS, RATES, REVOLUTE, Mechanism, Variables

if TYPE_CHECKING:
    from .srdf import Srdf

Array = NDArray[np.float64]
Limits = Mapping[str, tuple[float, float]]
"""Lower and upper limit of joints, by name, [rad] or [m]."""
_Any = TypeVar("_Any", bound=Mechanism)


class Frame(NamedTuple):
    """Position in the chain of a link, or of the part that a joint moves."""

    joints: int
    """Number of physical joints before it."""
    pose: Array
    """Pose in the frame that the last of these joints moves, or in the base, (4, 4), lengths in [m]."""


@dataclass(frozen=True, eq=False)
class SerialChain(Variables):
    """A serial arm from base to tip. Create one with `serial_chain`, which checks everything."""

    name: str
    base: str
    tip: str
    joint_names: tuple[str, ...]
    kinds: tuple[str, ...]
    """Kind of each variable: revolute, continuous or prismatic."""
    lower: Array
    """Lower limits, (n,), [rad] or [m]; a continuous joint has no limits, and is represented by [-π, π]; see
    `Problem.placed`."""
    upper: Array
    fixed: Array
    """``A_1 … A_m, A_tip``, (m+1, 3, 4)."""
    prismatic: NDArray[np.bool_]
    """Whether each physical joint is prismatic, (m,)."""
    leader: NDArray[np.int64]
    """Index of the variable that drives each physical joint, (m,)."""
    multiplier: Array
    offset: Array
    rates: Array
    """Limits of velocity, acceleration and jerk of each variable, (3, n), in the units of `RATES`, above 0; NaN if
    unknown."""
    source: str = field(default="", compare=False)
    """Source of the description, for display."""
    urdf: bytes = field(default=b"", compare=False, repr=False)
    """The URDF description with meshes, if there is one; for a xacro file its expanded text."""
    packages: Mapping[str, str | Path] = field(default_factory=dict, compare=False, repr=False)
    """Folders of ROS packages that were given with it, by name."""
    srdf: Srdf | None = field(default=None, compare=False, repr=False)
    """The SRDF that was given with it, if any."""
    states: Mapping[str, Mapping[str, float]] = field(default_factory=dict, repr=False)
    """Values of its joints by joint, [rad] or [m], in each state of its group in the SRDF, by state."""
    frames: Mapping[str, Frame] = field(default_factory=dict, repr=False)
    """Links and joints whose poses can be computed, by name; a link takes precedence over a joint of the same name."""
    locked: tuple[tuple[str, float], ...] = ()
    """Joints that were locked and their values, [rad] or [m], for display."""
    tooled: bool = False
    """Whether the tip was moved to a tool."""

    @property
    def axes(self) -> SerialChain:
        """The chain itself: it has axes and links; see `Mechanism`."""
        return self

    @lazy
    def periodic(self) -> NDArray[np.bool_]:
        """Whether a full turn of each variable leaves the poses of all links unchanged, (n,)."""
        turns = np.ones(self.dof, dtype=np.bool_)
        for k, i in enumerate(self.leader):
            turns[i] &= not self.prismatic[k] and float(self.multiplier[k]).is_integer()
        return turns

    @lazy
    def reach(self) -> float:
        """Upper bound of the distance between tip and base [m]: the sum of all links and slides."""
        ends = self.multiplier * np.stack([self.lower, self.upper])[:, self.leader] + self.offset
        slides = float(np.abs(ends).max(axis=0)[self.prismatic].sum())
        return float(np.linalg.norm(self.fixed[:, :, 3], axis=1).sum()) + slides

    @lazy
    def length(self) -> float:
        """Length of the stretched arm from its first axis on [m]: links, and the longer half of each slide."""
        links = float(np.linalg.norm(self.fixed[1:, :, 3], axis=1).sum())
        for k in np.flatnonzero(self.prismatic):
            i = self.leader[k]
            links += max(abs(self.lower[i]), abs(self.upper[i])) * abs(float(self.multiplier[k])) / 2
        return max(links, 1e-3)

    @lazy
    def arrays(self) -> ChainArrays:
        """The chain in the form that kernels take."""
        return chain_arrays(
            self.fixed, self.prismatic, self.leader, self.multiplier, self.offset, (self.lower, self.upper)
        )

    @property
    def cheap(self) -> bool:
        """True: no Python code runs for a pose."""
        return True

    @property
    def partial(self) -> bool:
        """False: every q has a pose."""
        return False

    @property
    def single(self) -> bool:
        """False: all computations use double precision."""
        return False

    def limited(
        self, lower: Array, upper: Array, kinds: tuple[str, ...], rates: Array | None = None
    ) -> SerialChain:
        """Return the same chain with other limits, (n,), kinds that fit them, and if given other rates, (3, n)."""
        rates = self.rates if rates is None else rates
        return replace(self, lower=lower, upper=upper, kinds=kinds, rates=rates)

    def part(self, joints: tuple[int, ...], q: Array, tool: Array | None) -> SerialChain:
        """Return the same chain in which only some joints move; see `Mechanism`."""
        locked = {name: float(q[i]) for i, name in enumerate(self.joint_names) if i not in joints}
        chain = with_locked(self, locked)
        return chain if tool is None else with_tool(chain, tool)

    def forward(self, q: Array) -> Array:
        """Return poses of the tip, (k, n) -> (k, 4, 4), lengths in [m]."""
        return in_chunks(lambda some: forward_many(self.arrays, some), q)

    def arrays_to(self, frame: Frame) -> ChainArrays:
        """Return the chain in the form that kernels take, ending at a frame that some joint moves."""
        m = frame.joints
        return chain_arrays(
            np.concatenate([self.fixed[:m], frame.pose[None, :3]]),
            self.prismatic[:m],
            self.leader[:m],
            self.multiplier[:m],
            self.offset[:m],
            (self.lower, self.upper),
        )


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
        rates=chain.rates[:, left],
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


def with_limits(chain: _Any, limits: Limits, rates: Mapping[str, Any] = MappingProxyType({})) -> _Any:
    """Narrow the limits of joints; a continuous joint with limits becomes a revolute one.

    Args:
        chain: The arm.
        limits: Lower and upper limit of each joint to narrow, by name, [rad] or [m].
        rates: Limits of some of `RATES`, by their name, in their units: one number, one for each joint, or a mapping from
            some joints to numbers; None leaves a limit as it is.

    Raises:
        InvalidRobot: A joint is unknown, or limits are invalid, inverted, or wider than those of the arm; for a continuous
            joint, wider than a full turn.
    """
    lower, upper, kinds = chain.lower.copy(), chain.upper.copy(), list(chain.kinds)
    for name, pair in _named(chain, limits, "limits (lower, upper)"):
        i = chain.joint_names.index(name)
        low, high = limits_pair(name, pair)
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
    return cast("_Any", chain.limited(lower, upper, tuple(kinds), _narrowed_rates(chain, rates)))


def _narrowed_rates(chain: Mechanism, given: Mapping[str, Any]) -> Array:
    """Return the limits of velocity, acceleration and jerk of an arm, (3, n), with those that are given in their place.

    Raises:
        InvalidRobot: They do not fit the arm, or one is wider than that of the arm.
    """
    rates = chain.rates.copy()
    for row, (name, unit) in zip(rates, RATES.items(), strict=True):
        if given.get(name) is None:
            continue
        for joint, limit in _by_joint(chain, name, given[name]).items():
            i = chain.joint_names.index(joint)
            value = _number(limit, f"joint {joint!r}: the {name} limit [{unit}]")
            if value <= 0:
                raise InvalidRobot(
                    f"joint {joint!r}: the {name} limit [{unit}] must be above 0, got {value:g}"
                )
            if value > row[i]:
                raise InvalidRobot(
                    f"joint {joint!r}: {name} limit {value:g} is wider than that of the arm, {row[i]:g} [{unit}]"
                )
            row[i] = value
        warn_of_rates(name, chain.joint_names, chain.kinds, row, "with_limits", 4)
    return rates


def _by_joint(chain: Mechanism, name: str, given: Any) -> dict[str, Any]:
    """Return limits by joint: those of a mapping, or one number or a number for each joint.

    Raises:
        InvalidRobot: A joint is unknown, or they are none of these.
    """
    if isinstance(given, Mapping):
        return dict(_named(chain, given, "numbers"))
    try:
        row = np.broadcast_to(as_float_array(given), (chain.dof,)).tolist()
    except (TypeError, ValueError, OverflowError):
        raise InvalidRobot(
            f"{name} must be one number, {chain.dof} of them, or a mapping from joints to numbers [{RATES[name]}], got "
            f"{given!r:.80}"
        ) from None
    return dict(zip(chain.joint_names, row, strict=True))


def limits_pair(name: str, pair: Any) -> tuple[float, float]:
    """Return the lower and the upper limit of a joint from a pair of numbers.

    Raises:
        InvalidRobot: It is no pair of finite numbers, or the lower limit is above the upper one.
    """
    try:
        low, high = (_number(end, f"a limit of joint {name!r}") for end in pair)
    except (TypeError, ValueError, OverflowError) as error:
        if isinstance(error, InvalidRobot):
            raise
        raise InvalidRobot(f"limits of joint {name!r} must be a pair (lower, upper), got {pair!r}") from None
    if low > high:
        raise InvalidRobot(f"joint {name!r}: lower limit {low:g} is above upper limit {high:g}")
    return low, high


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


def joint_frames(chain: SerialChain, q: Array) -> tuple[Array, Array]:
    """Return frames of the physical joints before and after they move, for pictures.

    Args:
        chain: The arm, with m physical joints.
        q: Joint values, (k, n), [rad] or [m].

    Returns:
        The frames before and after, in the base, (k, m, 4, 4) each, lengths in [m]. A joint moves about or along its z axis.
    """
    values = chain.multiplier * q[:, chain.leader] + chain.offset
    T = np.broadcast_to(np.eye(4), (len(q), 4, 4))
    before, after = [], []
    for k, value in enumerate(values.T):
        move = np.zeros((len(q), 4, 4)) + np.eye(4)
        if chain.prismatic[k]:
            move[:, 2, 3] = value
        else:
            move[:, 0, 0] = move[:, 1, 1] = np.cos(value)
            move[:, 1, 0] = np.sin(value)
            move[:, 0, 1] = -move[:, 1, 0]
        before.append(T @ square(chain.fixed[k]))
        after.append(T := before[-1] @ move)
    return np.stack(before, axis=1), np.stack(after, axis=1)


def joint_points(chain: SerialChain, q: Array) -> Array:
    """Return positions of the base, of both ends of every slide, of every other joint and of the tip, for pictures.

    Args:
        chain: The arm, with m physical joints of which s are prismatic.
        q: Joint values, (n,).

    Returns:
        Positions from base to tip, (m + s + 2, 3), [m].
    """
    before, after = (frames[0] for frames in joint_frames(chain, q[None]))
    points = [np.zeros(3)]
    for k, slides in enumerate(chain.prismatic):
        points += [before[k, :3, 3], after[k, :3, 3]] if slides else [before[k, :3, 3]]
    return np.array([*points, (after[-1] @ square(chain.fixed[-1]))[:3, 3]])
