"""The class `Goal`: the pose to reach, or the part of it that matters, and its tolerances."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from typing import Any, Literal, Self, Unpack

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidGoal, InvalidProblem
from .kernels.arm.pose_error import judge
from .kernels.arm.range_error import CONE, FRAME, HIGH, LOW, QUESTION, SWING, SWINGS, judge_ranges
from .kernels.arrays import ChainArrays, GoalArrays
from .kinds import BOX, KINDS, PLAIN_KINDS, POINTING, POSE, POSITION, Kind
from .pose_arguments import at_position, unit_vector, x_onto
from .poses import as_pose, one_pose, plain_place, row_of, rpy_of
from .ranges import (
    AXES,
    FRAMES,
    FREE_PLACE,
    FREE_TURN,
    PINNED,
    Ranges,
    check_cone,
    check_ranges,
    free_turns,
    read_ranges,
    unit,
)
from .support.interrupts import in_chunks
from .support.lazy import Lazy, lazy
from .support.transforms import inverse, rotation_onto
from .tolerances import (
    DEFAULT_TOLERANCE,
    DEFAULT_WEIGHT,
    TOLERANCES,
    WEIGHTS,
    GoalOptions,
    check_tolerance,
    check_weight,
    said,
)
from .unknown_arguments import unknown_argument

Array = NDArray[np.float64]


Frame = Literal["tool", "base"]
"""Frame whose axes the deviation of a goal is measured along; see `Goal`."""


@dataclass(frozen=True, eq=False)
class Goal(Lazy):
    """The part of the tip's pose that matters, its tolerances, and the weights of position and orientation.

    Build one with `Goal.pose`, `Goal.position` or `Goal.pointing`.

    There are two separate measures. The *tolerances*, in [m] and [rad], decide success. The *weights* are the paper's K_P
    and K_A (Sec. 2.2): they guide the searches, and define "nearest" if the goal is out of reach.

    A goal may leave axes *free*, or give them a *range* within which any deviation is accepted. Let T = (R, p) be the pose
    reached and T_g = (R_g, p_g) the target. The deviation has six components, along the axes of the `frame`:

    - x, y, z: the components of p - p_g, [m];
    - rx, ry, rz: the components of the rotation vector (axis times angle, at most π long) of R_gᵀ R with ``frame="tool"``
      (the axes of the target pose), or of R R_gᵀ with ``frame="base"`` (the axes of the frame in which the goal is given).

    The position error is the length of the vector by which x, y, z exceed their ranges; the orientation error is the same
    for rx, ry, rz. A free axis has the range of all values. If one rotation axis is free and the other two have no range,
    the orientation error is the angle between the directions of that axis in the reached and in the target pose. This is
    exactly the error of a pointing goal; in the tool frame, with nothing else free, the goal becomes a pointing goal. With a
    *cone* any such angle up to that of the cone is accepted, and the orientation error is the rest. If all three rotation
    axes are free and nothing else is, it becomes a position goal. The weighted error of a goal with ranges is
    K_P times the position error plus K_A (1 - cos of the orientation error).
    """

    target: Array
    """Wanted pose of the tip in the base, (..., 4, 4), lengths in [m]. Leading dimensions are the batch."""
    kind: str = POSE.name
    """``"pose"``, ``"position"`` (any orientation), ``"pointing"`` (any rotation about the tool axis) or ``"box"``."""
    tool_axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    """The axis of the tip that a pointing goal aligns, in tip coordinates."""
    position_tolerance: float = DEFAULT_TOLERANCE
    """Largest position error that counts as success [m]."""
    orientation_tolerance: float = DEFAULT_TOLERANCE
    """Largest orientation error that counts as success [rad]."""
    position_weight: float = DEFAULT_WEIGHT
    """The paper's K_P, per [m]."""
    orientation_weight: float = DEFAULT_WEIGHT
    """The paper's K_A, per unit of 1 - cos φ."""
    tool: Array | None = None
    """T_tip_tool, (4, 4): the goal is a pose of the tool, and errors are measured there. None: of the tip."""
    base: Array | None = None
    """T_reference_base, (4, 4): pose of the arm's base in the frame in which the goal is given. None: the identity."""
    ranges: Ranges | None = None
    """For a box goal: lower and upper end of the deviation along x, y, z [m] and rx, ry, rz [rad]; see `Goal.pose`."""
    frame: Frame = "tool"
    """For a box goal: ``"tool"`` or ``"base"``, the frame whose axes the ranges are along."""
    swing: tuple[float, float, float] | None = None
    """For a box goal: the axis in the frame of which only the direction matters; rx, ry, rz then have no ranges."""
    cone: float = 0.0
    """For a box goal with such an axis: the largest accepted angle between its directions [rad]; see `Goal.pose`."""

    def __post_init__(self) -> None:
        """Validate every field.

        Raises:
            InvalidGoal: A tolerance is negative or not finite, a weight is not positive, a number is too large or too small
                to compute with, an axis is no vector longer than zero, or the target is not a pose.
        """
        for name in TOLERANCES:
            check_tolerance(name, getattr(self, name))
        for name in WEIGHTS:
            check_weight(name, getattr(self, name))
        if self.kind not in KINDS:
            valid = ", ".join(repr(kind.name) for kind in PLAIN_KINDS)
            raise InvalidGoal(f"kind must be one of {valid}, got {self.kind!r}")
        if self.frame not in FRAMES:
            raise InvalidGoal(f"frame must be 'tool' or 'base', got {self.frame!r}")
        if self.form.ranges != (self.ranges is not None):
            raise InvalidGoal(
                "a goal has ranges if and only if its kind is 'box'; Goal.pose(..., box=...) makes one"
            )
        if self.ranges is not None:
            object.__setattr__(self, "ranges", check_ranges(self.ranges))
        for name in ("tool", "base"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, one_pose(getattr(self, name), name))
        object.__setattr__(self, "tool_axis", _unit_axis(self.tool_axis, "tool_axis"))
        if self.swing is not None:
            object.__setattr__(self, "swing", _unit_axis(self.swing, "swing"))
        object.__setattr__(self, "cone", check_cone(self.cone, self.swing is not None))
        object.__setattr__(self, "target", as_pose(self.target))

    @classmethod
    def pose(
        cls,
        target: Any,
        *,
        free: str | Iterable[str] = (),
        box: Mapping[str, Sequence[float]] | None = None,
        cone: float = 0.0,
        frame: Frame = "tool",
        **options: Unpack[GoalOptions],
    ) -> Self:
        """Make a goal of a whole pose, or of all of it but some axes; `Goal` defines how deviations are measured.

        Args:
            target: (..., 4, 4), or an object that carries a 4x4 (SciPy, pinocchio, spatialmath).
            free: Axes among x, y, z, rx, ry, rz along and about which any deviation is accepted: one name, or several.
            box: A range (lower, upper) of accepted deviations for some axes, [m] or [rad]. A length may be infinite; an
                angle lies in [-π, π].
            cone: With one free rotation axis, as in ``free="rz", cone=0.17``: the largest accepted angle between the
                directions of that axis in the reached and in the target pose, in [0, π] rad.
            frame: ``"tool"``: the axes are those of the target pose; ``"base"``: those of the frame in which the goal is
                given.
            options: Tolerances, weights, ``tool=`` and ``base=``, as named in `Goal`.

        Raises:
            InvalidGoal: Not a pose, an option out of its range, an unknown axis, an axis that is both free and boxed, an
                invalid range, a cone about no axis or about several, or a goal that leaves everything free.
        """
        if options:
            _require_options(cls.pose, options)
        ranges = read_ranges(free, box)
        if frame not in FRAMES:
            raise InvalidGoal(f"frame must be 'tool' or 'base', got {frame!r}")
        turns = [] if ranges is None else free_turns(ranges)
        # Goals that another kind expresses exactly become that kind, because more searches and proofs support it.
        alone = ranges is not None and len(turns) == 1 and ranges[3:].count(PINNED) == 2
        cone = check_cone(cone, alone)
        if ranges is None or all(pair == PINNED for pair in ranges):
            return cls(target, **options)
        if ranges[:3] == (PINNED,) * 3 and len(turns) == 3:
            return cls(target, kind=POSITION.name, **options)
        if ranges[:3] == (PINNED,) * 3 and alone and frame == "tool" and not cone:
            return cls(target, kind=POINTING.name, tool_axis=unit(turns[0]), **options)
        swing = unit(turns[0]) if alone else None
        return cls(target, kind=BOX.name, ranges=ranges, frame=frame, swing=swing, cone=cone, **options)

    @classmethod
    def position(
        cls,
        position: ArrayLike,
        *,
        free: str | Iterable[str] = (),
        box: Mapping[str, Sequence[float]] | None = None,
        **options: Unpack[GoalOptions],
    ) -> Self:
        """Make a goal of the tip's position with any orientation.

        Args:
            position: Position of the tip in the base [m], (..., 3).
            free: Axes among x, y and z of the base along which any deviation is accepted.
            box: A range (lower, upper) of accepted deviations for some of these axes, [m].
            options: Tolerances, weights, ``tool=`` and ``base=``, as named in `Goal`.

        Raises:
            InvalidGoal: Wrong shape, NaN or infinity, an option out of its range, or axes as in `Goal.pose`.
        """
        if options:
            _require_options(cls.position, options)
        # The short way skips checks that a plain position with default options does not need.
        usual = cls is Goal and not options and box is None and type(free) is tuple and not free
        if usual and (at := plain_place(position)) is not None:
            return cls._checked(at, POSITION)
        ranges, target = read_ranges(free, box, POSITION), at_position(position, np.eye(3))
        if ranges is None:
            return cls(target, kind=POSITION.name, **options)
        return cls(target, kind=BOX.name, ranges=ranges, frame="base", **options)

    @classmethod
    def pointing(
        cls,
        position: ArrayLike,
        direction: ArrayLike,
        tool_axis: Sequence[float] = (0.0, 0.0, 1.0),
        *,
        cone: float = 0.0,
        free: str | Iterable[str] = (),
        box: Mapping[str, Sequence[float]] | None = None,
        **options: Unpack[GoalOptions],
    ) -> Self:
        """Make a goal of a position and a direction of the tool axis; the rotation about that axis is free.

        Args:
            position: Position of the tip in the base [m], (..., 3).
            direction: Direction of the tool axis in base coordinates, (3,), of any length but zero.
            tool_axis: The axis in tip (or tool) coordinates, (3,), of any length but zero.
            cone: Largest accepted angle between the tool axis and the direction, in [0, π] rad.
            free: Axes among x, y and z of the base along which any deviation is accepted.
            box: A range (lower, upper) of accepted deviations for some of these axes, [m].
            options: Tolerances, weights, ``tool=`` and ``base=``, as named in `Goal`.

        Raises:
            InvalidGoal: Wrong shape, NaN or infinity, a zero vector, an option out of its range, or axes as in `Goal.pose`.
        """
        if options:
            _require_options(cls.pointing, options)
        axis, onto = unit_vector(tool_axis, "tool_axis"), unit_vector(direction, "direction")
        ranges, target = read_ranges(free, box, POINTING), at_position(position, rotation_onto(axis, onto))
        cone = check_cone(cone, True)
        if ranges is None and not cone:
            return cls(target, kind=POINTING.name, tool_axis=(axis[0], axis[1], axis[2]), **options)
        if (
            ranges is None
        ):  # The axes of the tool and of the base are equivalent then. Searches of the former are faster.
            swing = (axis[0], axis[1], axis[2])
            return cls(target, kind=BOX.name, ranges=(PINNED,) * 6, swing=swing, cone=cone, **options)
        swing = (float(onto[0]), float(onto[1]), float(onto[2]))
        return cls(target, kind=BOX.name, ranges=ranges, frame="base", swing=swing, cone=cone, **options)

    @classmethod
    def _checked(cls, target: Array, kind: Kind) -> Self:
        """Make a goal with default tolerances and weights from a valid pose that the goal may own."""
        goal = object.__new__(cls)
        goal.__dict__.update(_USUAL, target=target, kind=kind.name)
        return goal

    def __repr__(self) -> str:
        """One line: the target, and the options that are not the default."""
        parts = (
            [f"pose, batch of shape {self.shape}"]
            if self.shape
            else [f"pose at {row_of(self.target[:3, 3])} m"]
        )
        if not self.form.ranges:
            parts[0] = parts[0].replace(POSE.name, self.kind, 1)
        if self.form.turned:
            axis = row_of(self.tool_axis)
            along = f" along {row_of(self.target[:3, :3] @ self.tool_axis)}" if not self.shape else ""
            parts.append(f"tool axis {axis}{along}")
        elif self.form.columns and not self.shape:
            parts.append(f"rpy {row_of(rpy_of(self.target[:3, :3]))} rad")
        free, within = self.free if self.form.ranges else (), self.within
        for axis in AXES:
            if axis in free:
                parts.append(f"{axis} free")
            elif axis in within:
                parts.append(f"{axis} within {row_of(within[axis])}")
        if self.swing is not None:
            within_cone = f", within {row_of([self.cone])[1:-1]} rad" if self.cone else ""
            parts.append(f"only the direction of {row_of(self.swing)} counts{within_cone}")
        if self.ranges is not None:
            parts.append(f"frame={self.frame!r}")
        parts += said({name: getattr(self, name) for name in (*TOLERANCES, *WEIGHTS)})
        parts += [name for name in ("tool", "base") if getattr(self, name) is not None]
        return f"Goal({', '.join(parts)})"

    @property
    def form(self) -> Kind:
        """The kind: which parts of a pose the goal constrains."""
        return KINDS[self.kind]

    @property
    def seeded_as(self) -> Kind:
        """Kind of the samples used as seeds: goals whose ranges accept every orientation need positions only."""
        if not self.form.ranges or self.ranges is None:
            return self.form
        return POSITION if self.swing is None and len(free_turns(self.ranges)) == 3 else POSE

    @property
    def free(self) -> tuple[str, ...]:
        """Axes among x, y, z, rx, ry and rz with no constraint; for a direction, the axis nearest to it."""
        if self.ranges is not None:
            named = zip(AXES, self.ranges, strict=True)
            return tuple(axis for axis, pair in named if pair in (FREE_PLACE, FREE_TURN))
        if self.form.turned:
            return (AXES[3 + int(np.argmax(np.abs(self.tool_axis)))],)
        return () if self.form.columns else AXES[3:]

    @property
    def within(self) -> dict[str, tuple[float, float]]:
        """Axes with a range of accepted deviations, and the range: lower and upper end, [m] or [rad]."""
        named = dict(zip(AXES, self.ranges or (), strict=False))
        return {axis: pair for axis, pair in named.items() if pair != PINNED and axis not in self.free}

    @property
    def accepts_target(self) -> bool:
        """Return whether the target itself lies in all ranges."""
        return self.ranges is None or all(low <= 0.0 <= high for low, high in self.ranges)

    @property
    def prepared_as(self) -> tuple[Kind, bytes | None]:
        """Cache key of what an arm needs once for such a goal; goals with the same key share it."""
        return self.form, None if self.tip is None else self.tip.tobytes()

    def require_plain(self, what: str) -> None:
        """Reject free axes and ranges.

        Args:
            what: Name of the feature that does not support them.

        Raises:
            InvalidProblem: The goal has free axes or ranges.
        """
        if self.form.ranges:
            taken = ", ".join(kind.noun for kind in PLAIN_KINDS)
            raise InvalidProblem(
                f"{what} {self.form.noun}, only of {taken}. Use arm.ik with its default solver"
            )

    def measure(self, arrays: ChainArrays, q: Array) -> Array:
        """Compute the errors of joint values by plain forward kinematics.

        Args:
            arrays: The arm, its tip moved by `tip`; see `Problem.arrays`.
            q: Joint values, one row per target, (k, n), [rad] or [m].

        Returns:
            Position error [m], orientation error [rad] and weighted error of each, (k, 3).
        """
        if self.form.ranges:
            weights = float(self.position_weight), float(self.orientation_weight)
            return in_chunks(
                lambda some, questions: judge_ranges(arrays, some, questions, *weights), q, self.questions
            )
        return in_chunks(lambda some, targets: judge(arrays, some, targets, self.arrays), q, self.targets)

    def met(self, measured: Array) -> NDArray[np.bool_]:
        """Return whether both tolerances are met, (k,), given the errors from `measure`, (k, 2 or more)."""
        near = measured[:, 0] <= self.position_tolerance
        return np.asarray(near & (measured[:, 1] <= self.orientation_tolerance))

    @property
    def axis_weights(self) -> Array:
        """K_A of the columns as kernels take it, (3,); for a goal with ranges only the first is used."""
        if self.form.ranges:
            return np.array([self.orientation_weight, 0.0, 0.0])
        return self.arrays.axis_weights

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of the batch; () for one pose."""
        return self.target.shape[:-2]

    def at(self, target: Array) -> Goal:
        """Return the same goal with another target, (..., 4, 4)."""
        return replace(self, target=target)

    @lazy
    def tip_rotation(self) -> Array:
        """Rotation of the tip that maps a pointing goal's tool axis to x, the axis that kernels align, (3, 3)."""
        if not self.form.turned:
            return np.eye(3)
        return x_onto(tuple(self.tool_axis))

    @property
    def columns(self) -> int:
        """Number of compared columns of the rotation: 3 for a pose, 1 (the tool axis, mapped to x) for a direction, else 0.

        Raises:
            InvalidProblem: The goal has ranges.
        """
        self.require_plain("this search does not support")
        return self.form.columns

    @property
    def paper_columns(self) -> int:
        """Number of rotation columns in the paper's error, x and y for a pose: 2, 1 or 0 (Sec. 2.2)."""
        return min(self.columns, 2)

    @lazy
    def tip(self) -> Array | None:
        """Transform that kernels append to the tip, (4, 4): the tool, and a pointing goal's rotation; None: identity."""
        if self.tool is None and not self.form.turned:
            return None
        end = np.eye(4) if self.tool is None else self.tool.copy()
        end[:3, :3] = end[:3, :3] @ self.tip_rotation
        return end

    @lazy
    def targets(self) -> Array:
        """Targets as kernels take them, in the arm's base, tip rotation included, (k, 3, 4)."""
        flat = self.target.reshape(-1, 4, 4)[:, :3].copy()
        if self.base is not None:
            flat = inverse(self.base) @ self.target.reshape(-1, 4, 4)
        if self.form.turned:
            flat[..., :3] = flat[..., :3] @ self.tip_rotation
        return flat

    @lazy
    def frames(self) -> Array:
        """Axes along which a box goal's ranges are measured, in the arm's base, as columns, (k, 3, 3)."""
        if self.frame == "tool":
            return np.ascontiguousarray(self.targets[:, :, :3])
        axes = np.eye(3) if self.base is None else self.base[:3, :3].T
        return np.ascontiguousarray(np.broadcast_to(axes, (len(self.targets), 3, 3)))

    @lazy
    def questions(self) -> Array:
        """Targets, frames and ranges of a box goal as kernels take them, (k, `QUESTION`)."""
        targets = self.targets
        rows = np.empty((len(targets), QUESTION))
        rows[:, :FRAME] = targets.reshape(-1, 12)
        rows[:, FRAME:LOW] = (targets[:, :, :3] if self.frame == "tool" else self.frames).reshape(-1, 9)
        rows[:, LOW:] = _range_numbers(self.ranges or (PINNED,) * 6, self.swing, self.cone)
        return rows

    @lazy
    def arrays(self) -> GoalArrays:
        """The first target with the paper's weights: the x and y columns are compared for a pose (Sec. 2.2)."""
        return GoalArrays(
            self.targets[0] if len(self.targets) else np.eye(4)[:3].copy(),
            float(self.position_weight),
            self.orientation_weight * (np.arange(3) < self.paper_columns).astype(float),
        )


_AXES = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))

_USUAL = {each.name: each.default for each in fields(Goal)}
"""Default fields of a goal that is given by its target and kind alone."""


def _require_options(make: Callable[..., Goal], options: Mapping[str, Any]) -> None:
    """Reject options that are no fields of a goal.

    Raises:
        InvalidUse: There is one.
    """
    if unknown := [name for name in options if name not in Goal.__dataclass_fields__]:
        raise unknown_argument(make, unknown, GoalOptions.__annotations__)


@lru_cache(maxsize=64)
def _range_numbers(ranges: Ranges, swing: tuple[float, float, float] | None, cone: float) -> Array:
    """Return what questions have behind the frame, (QUESTION - LOW,); the array must not be modified."""
    row, ends = np.zeros(QUESTION), np.array(ranges)
    row[LOW:HIGH], row[HIGH:SWING] = ends[:, 0], ends[:, 1]
    if swing is not None:
        row[SWING:SWINGS], row[SWINGS], row[CONE] = swing, 1.0, cone
    return row[LOW:]


def _unit_axis(axis: Any, name: str) -> tuple[float, float, float]:
    """Return an axis at length 1; one that has this length up to rounding stays as it is."""
    if type(axis) is tuple and axis in _AXES:
        return _AXES[_AXES.index(axis)]
    x, y, z = unit_vector(axis, name)
    given = np.asarray(axis, dtype=np.float64)
    if abs(float(given @ given) - 1.0) <= 1e-15 * 8:
        x, y, z = given
    return float(x), float(y), float(z)
