"""What an arm is and where its links go: names, limits, forward kinematics, and other arms made of it.

`kinseek.Arm` adds to it what is the other way round.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .errors import InvalidProblem, suggest
from .goal import Goal
from .kernels.arm.forward import forward_many
from .kernels.arm.jacobian import jacobian_many
from .lazy import Lazy
from .poses import one_pose
from .printable import printable
from .problem import Problem, as_joints
from .robots import Mechanism, SerialChain, as_mechanism, black_box, read_dh
from .robots.geometry import arm_length
from .robots.mechanism import no_axes
from .robots.variants import with_limits, with_locked, with_tool
from .shapes import Joints, Matrix, Pose, Poses, Rows, Unshaped, Vector
from .structure.structure import FUNCTION, Structure, structure_of
from .validation import as_integer

Array = NDArray[np.float64]

MOST_NUMBERS = 2**31
"""Joint values that are drawn at a time: 16 GiB."""

_LARGEST_SEED = 2**128
"""`numpy.random.SeedSequence` makes seeds of so many bits."""


class ForwardArm(Lazy):
    """An arm as far as its forward kinematics go; `kinseek.Arm` is one that can also be asked for joint values."""

    def __init__(self, mechanism: Mechanism) -> None:
        """Wrap what a reader made."""
        self._mechanism = as_mechanism(mechanism)
        self._axes = self._mechanism.axes

    def _with(self, mechanism: Mechanism) -> Self:
        """The same arm in all but its mechanism."""
        arm = copy(self)
        arm._mechanism, arm._axes = mechanism, mechanism.axes
        return arm

    @classmethod
    def from_dh(
        cls,
        rows: Sequence[Sequence[float] | Mapping[str, float]] | Array,
        lower: ArrayLike | Mapping[str, float],
        upper: ArrayLike | Mapping[str, float],
        **options: Any,
    ) -> Self:
        """Build an arm from Denavit-Hartenberg rows (a [m], alpha [rad], d [m], theta [rad]).

        Args:
            rows: One a joint, (n, 4), or mappings with the names a, alpha, d and theta.
            lower: Lower limits, (n,) or by name of joint, [rad] or [m].
            upper: Upper limits, likewise; infinite limits make a continuous joint.
            options: ``convention="standard" | "modified"``, ``kinds="RRP…"``, ``names``, ``base`` and
                ``tool`` (4, 4), ``name``; see `kinseek.robots.read_dh`.

        Raises:
            InvalidRobot: Wrong shapes, NaN, unknown convention or kind, lower above upper.
        """
        return cls(read_dh(rows, lower, upper, **options))

    @classmethod
    def from_fk(
        cls,
        fk: Callable[[Any], Any],
        lower: ArrayLike | Mapping[str, float],
        upper: ArrayLike | Mapping[str, float],
        vectorized: bool = True,
        *,
        names: Sequence[str] | None = None,
        kinds: str | Sequence[str] | None = None,
        partial: bool = False,
        name: str = "black_box",
    ) -> Self:
        """Build an arm from nothing but its forward kinematics: any mechanism at all.

        Args:
            fk: A function of joint values, (k, n) -> (k, 4, 4), or (n,) -> (4, 4) with ``vectorized=False``; lengths in
                [m]. A Numba-compiled function of one row is looped over in compiled code. Searches ask it inside the
                limits only; the same q must give the same pose.
            lower: Lower limits, (n,), in whatever units `fk` takes; or by name, which also gives the joints their names and
                their order, unless `names` does.
            upper: Upper limits, likewise.
            vectorized: Does `fk` take many rows at once?
            names: One a joint, all different.
            kinds: One word, or one a joint: ``"number"`` is a number between its limits and nothing else is assumed of
                it (the default); ``"revolute"`` an angle [rad] whose pose repeats after 2π; ``"continuous"`` one that
                turns without end, its limits are not read; ``"prismatic"`` a slide [m].
            partial: `fk` answers NaN where the mechanism cannot be put together; such joint values are never an answer.
                Without it NaN is an error.
            name: Of the mechanism, for messages.

        Raises:
            InvalidRobot: Not a function, limits that do not fit, unknown kinds, names not unique.
            FailedKinematics: `fk` raises or gives no rigid transform, now or in a later search; it names the q.
        """
        return cls(
            black_box(
                fk, lower, upper, vectorized=vectorized, names=names, kinds=kinds, partial=partial, name=name
            )
        )

    @property
    def mechanism(self) -> Mechanism:
        """What the arm is made of: a `SerialChain`, or a `BlackBox` where only a function is known."""
        return self._mechanism

    @property
    def axes(self) -> SerialChain | None:
        """Its axes and links; None where only a function is known."""
        return self._axes

    @property
    def chain(self) -> SerialChain:
        """Its axes and links, for what cannot do without them.

        Raises:
            InvalidProblem: The arm is a function; `mechanism` is there, and `axes` is None.
        """
        return self._require_axes("a chain is made of axes and links")

    @property
    def structure(self) -> Structure:
        """Which of its axes meet or run parallel, how exactly, and what comes of it: a word and a sentence.

        Where that makes a closed form, `branches` does not search; where it does so once a joint is given, `ik` seldom does.
        """
        axes = self._axes
        return FUNCTION if axes is None else structure_of(axes.arrays, arm_length(axes))

    @property
    def name(self) -> str:
        """Name of the robot."""
        return self._mechanism.name

    @property
    def dof(self) -> int:
        """Number of joint variables n."""
        return self._mechanism.dof

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joint variables, base to tip."""
        return self._mechanism.joint_names

    @property
    def kinds(self) -> tuple[str, ...]:
        """Of each joint variable: ``"revolute"``, ``"continuous"`` or ``"prismatic"``; of a function also ``"number"``."""
        return self._mechanism.kinds

    @property
    def base(self) -> str:
        """Name of the link in which poses are given."""
        return self._mechanism.base

    @property
    def tip(self) -> str:
        """Name of the link whose pose is meant, or that carries the tool of `with_tool`."""
        return self._mechanism.tip

    @property
    def lower(self) -> Array:
        """Lower limits, (n,), [rad] or [m].

        A continuous joint has no limits: lower and upper are -π and π, one turn in which answers lie unless `near` asks for
        another.
        """
        return self._mechanism.lower.copy()

    @property
    def upper(self) -> Array:
        """Upper limits, (n,), [rad] or [m]; see `lower`."""
        return self._mechanism.upper.copy()

    @property
    def velocity(self) -> Array:
        """How fast each joint may go by the robot's file, (n,), [rad/s] or [m/s]; NaN where it gives no speed above 0.

        A URDF gives it in ``<limit velocity=…>``, where 0 stands if nobody knew it; MJCF, Denavit-Hartenberg rows and
        functions have no place for it. A joint that others mimic goes no faster than these may.
        """
        return self._mechanism.velocity.copy()

    def sample(self, n: int, seed: int = 0) -> Rows:
        """Joint values drawn uniformly from inside the limits; the same seed gives the same values.

        Args:
            n: How many.
            seed: A whole number of at least 0.

        Returns:
            (n, dof), [rad] or [m].

        Raises:
            InvalidProblem: `n` or `seed` is no whole number of at least 0, or the values would take more than 16 GiB.
        """
        rows = as_integer("n", n, 0, error=InvalidProblem)
        seed = as_integer("seed", seed, 0, _LARGEST_SEED, InvalidProblem)
        if rows * self.dof > MOST_NUMBERS:
            raise InvalidProblem(
                f"n must be at most {MOST_NUMBERS // self.dof:,} for {self.dof} joints, got {rows:,}: the joint values "
                f"would take {8 * rows * self.dof / 2**30:,.0f} GiB. Draw fewer at a time, each time with another seed"
            )
        drawn = np.random.default_rng(seed).uniform(
            self._mechanism.lower, self._mechanism.upper, (rows, self.dof)
        )
        within: Rows = np.clip(
            drawn, self._mechanism.lower, self._mechanism.upper
        )  # Rounding may lead past a limit.
        return within

    @overload
    def fk(self, q: Unshaped, link: str | None = None) -> Array: ...
    @overload
    def fk(self, q: Vector | Sequence[float], link: str | None = None) -> Pose: ...
    @overload
    def fk(self, q: Matrix | Sequence[Sequence[float]], link: str | None = None) -> Poses: ...
    @overload
    def fk(self, q: Mapping[str, float], link: str | None = None) -> Pose: ...
    @overload
    def fk(self, q: Joints, link: str | None = None) -> Array: ...
    def fk(self, q: Joints, link: str | None = None) -> Array:
        """Pose of the tip in the base, or of any link on the way to it.

        Args:
            q: Joint values, (..., n), [rad] or [m]; may lie outside the limits. Or by name, in any order: a mapping from
                every joint of `joint_names` to its value or its values, (...); or an object with ``name`` and ``position``,
                as a ROS JointState, whose further joints are passed over.
            link: Name of a link or joint between base and tip, fixed ones included. A joint stands for the frame that it
                moves, a name of both for the link. Without it: the tip, moved to the tool of `with_tool` if there is one;
                ``link=arm.tip`` is the link that carries the tool.

        Returns:
            Transforms, (..., 4, 4), lengths in [m].

        Raises:
            InvalidProblem: A wrong shape, NaN or infinity, unknown or lacking names, an unknown link, or a link of an arm
                that is a function.
            FailedKinematics: The arm is a function, and it fails.
        """
        joints = as_joints(self._mechanism, q)
        flat = np.ascontiguousarray(joints.reshape(-1, self.dof))
        if link is not None:
            chain = self._require_axes("fk(link=...) asks for a link")
            if link not in chain.frames:
                raise InvalidProblem(suggest(str(link), chain.frames, "link or joint"))
            arrays = chain.arrays_to(chain.frames[link])
            return forward_many(arrays, flat).reshape(*joints.shape[:-1], 4, 4)
        return self._mechanism.forward(flat).reshape(*joints.shape[:-1], 4, 4)

    def jacobian(self, q: Joints) -> Array:
        """How fast the tip moves and turns for each joint: the geometric Jacobian (Siciliano et al. 2009, Sec. 3.1).

        Rows 0 to 2 are the velocity of the tip's origin, rows 3 to 5 the angular velocity, both along the axes of the base.
        So ``jacobian(q) @ dq`` is the twist that joint velocities ``dq`` give the tip, which is the tool of `with_tool` if
        there is one. A joint that others mimic moves these too.

        Args:
            q: Joint values, (..., n), [rad] or [m], or by name as `fk` takes them; may lie outside the limits.

        Returns:
            (..., 6, n): of a joint that turns [m/rad] and [rad/rad], of one that slides [m/m] and [rad/m].

        Raises:
            InvalidProblem: A wrong shape, NaN or infinity, or an arm that is a function, whose derivatives nobody knows.
        """
        chain = self._require_axes("a Jacobian is worked out from axes")
        joints = as_joints(self._mechanism, q)
        flat = np.ascontiguousarray(joints.reshape(-1, self.dof))
        return jacobian_many(chain.arrays, flat).reshape(*joints.shape[:-1], 6, self.dof)

    def manipulability(self, q: Joints) -> Any:
        """How far the arm is from singular: the product of the Jacobian's singular values (Yoshikawa 1985, eq. 4).

        It is √det(J Jᵀ) where the arm can move in all six directions. Of an arm that can do so nowhere, a planar one for
        example, only as many singular values count as it can have anywhere. Metres and radians are mixed, as in the paper:
        compare values of one arm.

        Args:
            q: Joint values, (..., n), [rad] or [m], or by name as `fk` takes them; may lie outside the limits.

        Returns:
            At least 0, and 0 at a singularity; a float, or (...).

        Raises:
            InvalidProblem: As `jacobian`.
        """
        J = self.jacobian(q)
        from .branches.index import freedom

        rank = self.dof - freedom(Problem(self._mechanism, Goal.pose(np.eye(4))))
        values = np.linalg.svd(J, compute_uv=False)[..., :rank].prod(axis=-1)
        return values if J.ndim > 2 else float(values)

    def with_locked(self, values: Mapping[str, float]) -> Self:
        """The arm with some joints locked; its `q` holds only the joints that are left.

        Args:
            values: Of each joint to lock, its value, [rad] or [m]. Joints that mimic it are locked with it.

        Raises:
            InvalidRobot: Unknown joints, values that are no numbers or outside the limits, or every joint locked.
        """
        return self._with(with_locked(self._require_axes("joints are locked along axes"), values))

    def with_limits(self, limits: Mapping[str, tuple[float, float]]) -> Self:
        """The arm with narrower limits.

        Args:
            limits: Of each joint to narrow, its lower and upper limit, [rad] or [m]. A continuous joint takes any up to
                a full turn apart.

        Raises:
            InvalidRobot: Unknown joints, limits that are no numbers, inverted, or wider than those of the arm.
        """
        return self._with(with_limits(self._mechanism, limits))

    def with_tool(self, tool: Any) -> Self:
        """The arm with its tip moved to a tool: `fk` and goals speak of it.

        Args:
            tool: T_tip_tool, (4, 4), or an object that carries one, lengths in [m].

        Raises:
            InvalidGoal: Not one pose.
        """
        chain = self._require_axes("a tool is put behind the last axis")
        return self._with(with_tool(chain, one_pose(tool, "tool")))

    def _require_axes(self, why: str) -> SerialChain:
        """The axes and links, or a refusal of what a function has not; `why` says what would need them."""
        if self._axes is None:
            raise InvalidProblem(no_axes(self._mechanism, why))
        return self._axes

    def _repr_html_(self) -> str:
        """For notebooks: the joints, and a picture in the middle of their limits."""
        from .notebook.cards import arm_card

        return arm_card(self)

    def __repr__(self) -> str:
        """Name, joints and frames; whether it carries a tool, and where joints are locked."""
        tool = " + tool" if self._axes is not None and self._axes.tooled else ""
        locked = () if self._axes is None else self._axes.locked
        where = "".join(f", {printable(name)} locked at {value:.6g}" for name, value in locked)
        joints = f"{self.dof} joint{'s' if self.dof > 1 else ''}"
        return f"{type(self).__name__}({self.name!r}, {joints}, {self.base!r} -> {self.tip!r}{tool}{where})"
