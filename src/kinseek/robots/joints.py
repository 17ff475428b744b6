"""A serial chain from the joints that a reader found, checked. The limits of a mimic joint narrow those of its leader."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from kinseek.errors import InvalidRobot
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.support.transforms import inverse, square

from .chain import Array, Frame, SerialChain
from .files import MOST_JOINTS, require_few
from .mechanism import CONTINUOUS, PRISMATIC, REVOLUTE

_AXIS_ROUNDING = 1e-3
"""Largest deviation of an axis from unit length that is accepted as rounding."""

_RIGID = 1e-5
"""Largest deviation of RRᵀ of an origin from the identity; a rotation written with six digits passes."""


@dataclass(frozen=True)
class Joint:
    """One moving joint of a chain, mimic joints included, in base-to-tip order."""

    name: str
    kind: str
    """``"revolute"``, ``"continuous"`` or ``"prismatic"``."""
    origin: Array
    """Pose of the joint frame in the preceding frame, (4, 4), lengths in [m]."""
    axis: Array
    """Axis of motion in the joint frame, (3,)."""
    lower: float
    """Lower limit, [rad] or [m], at most 1e7; ignored for continuous joints. The limits of a mimic joint narrow the range of
    its leader."""
    upper: float
    mimic: str | None = None
    """Name of the joint that this one follows by ``multiplier`` and ``offset``."""
    multiplier: float = 1.0
    offset: float = 0.0
    rates: tuple[float, float, float] = (np.nan, np.nan, np.nan)
    """Limits of velocity, acceleration and jerk, in the units of `RATES`, above 0; NaN if unknown. Those of a mimic joint
    also bound its leader."""


class Segment(NamedTuple):
    """Joints from one frame of a tree down to another one."""

    joints: list[Joint]
    end: Array
    """Pose of the lower frame in that of the last joint, (4, 4), lengths in [m]."""
    frames: list[tuple[str, Frame]]
    """Frames on the way by name, the upper one included."""


def joined(up: Segment, down: Segment) -> Segment:
    """Return the chain that goes up one segment and then down another one, which begins at the same frame.

    A joint that is taken upward moves the other way: of ``O J(q)`` the inverse is ``J(-q) O⁻¹``, and J(-q) is a motion by q
    about, or along, the opposite axis. So its value and limits keep their meaning.
    """
    if not up.joints and (up.end == np.eye(4)).all():
        return down  # It keeps its bits.
    backward = [_inverse(pose) for pose in (*(joint.origin for joint in up.joints), up.end)]
    """What follows each joint in the opposite direction, and what comes before all of them."""
    count = len(up.joints)
    joints = [
        replace(joint, origin=before, axis=-joint.axis)
        for joint, before in zip(up.joints[::-1], backward[:0:-1], strict=True)
    ]
    # A frame behind joint k is carried by the inverse of joint k + 1.
    frames = [(name, Frame(count - k, backward[k] @ pose)) for name, (k, pose) in reversed(up.frames)]
    top = backward[0]
    joints += [replace(joint, origin=top @ joint.origin) for joint in down.joints[:1]] + down.joints[1:]
    frames += [(name, Frame(count + k, pose if k else top @ pose)) for name, (k, pose) in down.frames]
    return Segment(joints, down.end if down.joints else top @ down.end, frames)


def _inverse(pose: Array) -> Array:
    return square(inverse(pose))


def serial_chain(
    joints: Sequence[Joint],
    tip_pose: Array,
    *,
    name: str,
    base: str,
    tip: str,
    source: str = "",
    links: Sequence[tuple[str, Frame]] = (),
) -> SerialChain:
    """Check the joints and convert them into the kernels' form.

    Args:
        joints: The moving joints from base to tip; fixed joints are already part of the origins.
        tip_pose: Pose of the tip in the last joint's frame, (4, 4), lengths in [m].
        name: Name of the arm.
        base: Name of the base link.
        tip: Name of the tip link.
        source: Source of the description.
        links: Further frames by name, with their poses in the frame of the last joint before them. Base, tip and joints are
            added.

    Raises:
        InvalidRobot: No movable joint, a missing or inverted limit, an invalid axis, a mimic joint without its leader, or a
            number that is too large for floating-point arithmetic.
    """
    variables = [joint for joint in joints if joint.mimic is None]
    if not joints:
        raise InvalidRobot(f"{name}: no movable joint between base {base!r} and tip {tip!r}")
    require_few(len(joints), "moving joints between base and tip", MOST_JOINTS, name)
    if twice := {joint for joint, count in Counter(joint.name for joint in joints).items() if count > 1}:
        raise InvalidRobot(f"{name}: joint names must be unique, these are not: {', '.join(sorted(twice))}")
    # Mimic joints are physical joints without a variable of their own.
    drive = _drive(joints, {joint.name: i for i, joint in enumerate(variables)})
    leader, multiplier, offset = zip(*drive, strict=True)
    variables = _narrowed(variables, joints, drive)
    lower, upper = np.array([_limits(joint) for joint in variables]).T
    for joint, (i, scale, shift) in zip(joints, drive, strict=True):
        farthest = abs(shift) + abs(scale) * max(abs(lower[i]), abs(upper[i]))
        if not max(farthest, abs(scale)) <= LARGEST:
            raise InvalidRobot(
                f"joint {joint.name!r} has limits up to {farthest:g} rad or m, and a mimic multiplier of "
                f"{abs(scale):g}; both must be at most {LARGEST:g}: farther off, joint values are rounded by more "
                "than 1e-9"
            )

    fixed = np.empty((len(joints) + 1, 3, 4))
    undo = np.eye(4)
    undone = [undo]
    for k, joint in enumerate(joints):
        align = np.eye(4)
        # Kernels rotate about z and slide along z only; the fixed transforms turn every axis there and back.
        align[:3, :3] = z_to(_unit_axis(joint))
        fixed[k] = (undo @ _rigid_pose(joint.origin, f"origin of joint {joint.name!r}") @ align)[:3]
        undo = align.T
        undone.append(undo)
    fixed[-1] = (undo @ _rigid_pose(tip_pose, "tip pose"))[:3]
    if not np.isfinite(fixed).all():
        raise InvalidRobot(f"{name}: a length overflows: lengths are in metres")

    frames: dict[str, Frame] = {}
    moved = [(joint.name, Frame(k + 1, np.eye(4))) for k, joint in enumerate(joints)]
    for called, (k, pose) in [
        (base, Frame(0, np.eye(4))),
        *links,
        (tip, Frame(len(joints), tip_pose)),
        *moved,
    ]:
        # A link may have the name of a joint: the link comes first in the list and wins.
        frames.setdefault(called, Frame(k, undone[k] @ pose))

    return SerialChain(
        name=name,
        base=base,
        tip=tip,
        joint_names=tuple(joint.name for joint in variables),
        kinds=tuple(joint.kind for joint in variables),
        lower=np.ascontiguousarray(lower),
        upper=np.ascontiguousarray(upper),
        fixed=fixed,
        prismatic=np.array([joint.kind == PRISMATIC for joint in joints]),
        leader=np.array(leader, dtype=np.int64),
        multiplier=np.array(multiplier, dtype=float),
        offset=np.array(offset, dtype=float),
        rates=_rates(joints, drive, len(variables)),
        source=source,
        frames=frames,
    )


class Mimics:
    """Mimic joints, possibly of other mimic joints; each is visited once."""

    def __init__(self, leaders: Mapping[str, tuple[str, float, float]]) -> None:
        """Take for each mimic joint: the joint it follows, multiplier, offset [rad] or [m]."""
        self._leaders = leaders
        self._drivers: dict[str, tuple[str, float, float]] = {}

    def __contains__(self, joint: str) -> bool:
        """Return whether a joint follows another one."""
        return joint in self._leaders

    def driver(self, joint: str) -> tuple[str, float, float]:
        """Return the joint that drives a mimic joint: its name, and the composed multiplier and offset [rad] or [m].

        Raises:
            InvalidRobot: The mimic joints form a loop.
        """
        way: dict[str, None] = {}  # In the order in which they were visited.
        last = joint
        while last in self._leaders and last not in self._drivers:
            if last in way:
                raise InvalidRobot(f"mimic joints form a loop: {' -> '.join([*way, last])}")
            way[last] = None
            last = self._leaders[last][0]
        # From the leader outwards, so that each mimic joint is composed once, however long the chain of leaders is.
        for name in reversed(way):
            leader, factor, shift = self._leaders[name]
            first, multiplier, offset = self._drivers.get(leader, (leader, 1.0, 0.0))
            self._drivers[name] = first, factor * multiplier, shift + factor * offset
        return self._drivers.get(joint, (joint, 1.0, 0.0))


def _drive(joints: Sequence[Joint], index: Mapping[str, int]) -> list[tuple[int, float, float]]:
    """Return index of the variable, multiplier and offset for each physical joint."""
    mimics = Mimics({j.name: (j.mimic, j.multiplier, j.offset) for j in joints if j.mimic is not None})
    drive = []
    for joint in joints:
        leader, multiplier, offset = mimics.driver(joint.name)
        if leader not in index:
            raise InvalidRobot(
                f"joint {joint.name!r} mimics {leader!r}, which does not move between base and tip. "
                f"Joints there: {', '.join(index) or 'none'}"
            )
        if not (np.isfinite(multiplier) and np.isfinite(offset)):
            raise InvalidRobot(f"mimic joint {joint.name!r}: multiplier and offset must be finite")
        drive.append((index[leader], multiplier, offset))
    return drive


def _narrowed(
    variables: Sequence[Joint], joints: Sequence[Joint], drive: Sequence[tuple[int, float, float]]
) -> list[Joint]:
    """Narrow the range of each variable so that its mimic joints stay inside their own limits."""
    cut = list(variables)
    for joint, (leader, multiplier, offset) in zip(joints, drive, strict=True):
        # Files contain 0 0 for limits that nobody specified, so equal limits of a mimic joint are ignored.
        limited = joint.kind != CONTINUOUS and np.isfinite([joint.lower, joint.upper]).all()
        if joint.mimic is None or not limited or joint.lower >= joint.upper:
            continue
        if multiplier == 0:
            if not joint.lower <= offset <= joint.upper:
                raise InvalidRobot(
                    f"mimic joint {joint.name!r} with limits [{joint.lower}, {joint.upper}] always stands at {offset}, "
                    f"outside of them: its multiplier is 0"
                )
            continue
        ends = sorted((bound - offset) / multiplier for bound in (joint.lower, joint.upper))
        old = cut[leader]
        if old.kind == CONTINUOUS:  # The joint itself is continuous, but its mimic joint has limits.
            cut[leader] = replace(old, kind=REVOLUTE, lower=ends[0], upper=ends[1])
            continue
        lower, upper = max(old.lower, ends[0]), min(old.upper, ends[1])
        if old.lower <= old.upper and lower > upper:
            raise InvalidRobot(
                f"mimic joint {joint.name!r} with limits [{joint.lower}, {joint.upper}] leaves no value for "
                f"joint {old.name!r} in [{old.lower}, {old.upper}]"
            )
        cut[leader] = replace(old, lower=lower, upper=upper)
    return cut


def _limits(joint: Joint) -> tuple[float, float]:
    if joint.kind == CONTINUOUS:
        return -np.pi, np.pi
    if why := wrong_limits(joint.lower, joint.upper):
        raise InvalidRobot(f"joint {joint.name!r}: {why}")
    return joint.lower, joint.upper


def wrong_limits(lower: float, upper: float) -> str:
    """Explain why a joint cannot have these limits, or return ""."""
    if not (np.isfinite(lower) and np.isfinite(upper)):
        return f"lower and upper limits must be finite, got [{lower}, {upper}]"
    return f"lower limit {lower} is above upper limit {upper}" if lower > upper else ""


def _rates(joints: Sequence[Joint], drive: Sequence[tuple[int, float, float]], variables: int) -> Array:
    """Return the limits of velocity, acceleration and jerk of each variable, (3, n): those of its slowest joint."""
    rates = np.full((3, variables), np.nan)
    for joint, (leader, multiplier, _) in zip(joints, drive, strict=True):
        if multiplier != 0:
            # `fmin` ignores NaN, the value of an unknown limit.
            rates[:, leader] = np.fmin(rates[:, leader], np.divide(joint.rates, abs(multiplier)))
    return rates


def _unit_axis(joint: Joint) -> Array:
    axis = np.asarray(joint.axis, dtype=float)
    if why := wrong_axis(axis):
        raise InvalidRobot(f"joint {joint.name!r}: {why}")
    return np.asarray(axis / float(np.linalg.norm(axis)))


def wrong_axis(axis: Array) -> str:
    """Explain why a joint cannot have this axis, (3,), or return ""."""
    length = math.hypot(*axis) if np.isfinite(axis).all() else math.nan  # Without a warning of overflow.
    if abs(length - 1.0) <= _AXIS_ROUNDING:
        return ""
    unit = " ".join(f"{value / length:.9g}" for value in axis) if length > 0 else "a unit vector"
    return f"axis {' '.join(f'{v:g}' for v in axis)} has length {length:g}, expected 1; write {unit}"


def z_to(axis: Array) -> Array:
    """Return the shortest rotation from z to `axis`, (3, 3)."""
    x, y, z = axis
    if z < 0:  # Use the other hemisphere, so that the formula never divides by almost zero.
        half_turn = np.diag([-1.0, 1.0, -1.0])
        return np.asarray(half_turn @ z_to(half_turn @ axis))
    return np.array(
        [
            [1 - x * x / (1 + z), -x * y / (1 + z), x],
            [-x * y / (1 + z), 1 - y * y / (1 + z), y],
            [-x, -y, z],
        ]
    )


def _rigid_pose(pose: Array, what: str) -> Array:
    pose = np.asarray(pose, dtype=float)
    if pose.shape != (4, 4):
        raise InvalidRobot(f"{what}: expected shape (4, 4), got {pose.shape}")
    if not np.isfinite(pose).all():
        raise InvalidRobot(f"{what}: contains NaN or infinity")
    if (farthest := float(np.abs(pose).max())) > LARGEST:
        raise InvalidRobot(
            f"{what}: expected lengths of at most {LARGEST:g} m, got {farthest:g} m: farther off, rounding of positions "
            f"comes close to 1e-6 m. Are these other units?"
        )
    turn = pose[:3, :3]
    off = float(np.abs(turn @ turn.T - np.eye(3)).max())
    if off > _RIGID:
        raise InvalidRobot(f"{what}: not a rotation: RRᵀ differs from the identity by {off:.3g}")
    return pose
