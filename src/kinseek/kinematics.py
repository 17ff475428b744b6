"""Forward kinematics of an arm: names, limits, poses of links, Jacobians, and modified copies of the arm.

`kinseek.Arm` adds the inverse kinematics.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from typing import Any, Self, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .derivatives import freedom
from .errors import InvalidProblem, suggest
from .goal import Goal
from .kernels.arm.forward import forward_many
from .kernels.arm.jacobian import jacobian_many
from .poses import one_pose
from .printable import printable
from .problem import Problem, as_joints
from .robots import Mechanism, SerialChain, as_mechanism, black_box, read_dh
from .robots.chain import with_limits, with_locked, with_tool
from .robots.mechanism import no_axes
from .structure.structure import FUNCTION, Structure, structure_of
from .support.interrupts import chunks, in_chunks
from .support.lazy import Lazy
from .support.shapes import Joints, Matrix, Pose, Poses, Rows, Unshaped, Vector
from .support.validation import as_integer

Array = NDArray[np.float64]

MOST_NUMBERS = 2**31
"""Maximum number of joint values drawn at a time: 16 GiB."""

_LARGEST_SEED = 2**128
"""`numpy.random.SeedSequence` makes seeds of at most this many bits."""


class ForwardArm(Lazy):
    """An arm with its forward kinematics; `kinseek.Arm` adds the inverse kinematics."""

    def __init__(self, mechanism: Mechanism) -> None:
        """Wrap the mechanism that a reader returned."""
        self._mechanism = as_mechanism(mechanism)
        self._axes = self._mechanism.axes

    def _with(self, mechanism: Mechanism) -> Self:
        """Return a copy of this arm with another mechanism."""
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
            rows: One row per joint, (n, 4), or mappings with the names a, alpha, d and theta.
            lower: Lower limits, (n,) or by name of joint, [rad] or [m].
            upper: Upper limits, in the same form; infinite limits make a continuous joint.
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
        """Build an arm from its forward kinematics alone, for any mechanism.

        Args:
            fk: A function of joint values, (k, n) -> (k, 4, 4), or (n,) -> (4, 4) with ``vectorized=False``; lengths in [m].
                A Numba-compiled function of one row is called in a compiled loop. Searches call it inside the limits only;
                the same q must give the same pose.
            lower: Lower limits, (n,), in the units that `fk` takes; or by name, which also defines the joints' names and
                their order unless `names` is given.
            upper: Upper limits, in the same form.
            vectorized: Does `fk` take many rows at once?
            names: One per joint, all different.
            kinds: One word for all joints, or one per joint. ``"number"`` (the default) is a number between its limits, with
                no other assumption; ``"revolute"`` an angle [rad] whose pose repeats after 2π; ``"continuous"`` an angle
                without limits, whose entries in `lower` and `upper` are ignored; ``"prismatic"`` a slide [m].
            partial: `fk` may return NaN where the mechanism cannot be assembled; such joint values are never a solution.
                Otherwise NaN is an error.
            name: Name of the mechanism, for messages.

        Raises:
            InvalidRobot: Not a function, limits that do not fit, unknown kinds, or names that are not unique.
            FailedKinematics: `fk` raises or returns no rigid transform, now or in a later search; the error names q.
        """
        return cls(
            black_box(
                fk, lower, upper, vectorized=vectorized, names=names, kinds=kinds, partial=partial, name=name
            )
        )

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism: a `SerialChain`, or a `BlackBox` for black-box kinematics."""
        return self._mechanism

    @property
    def axes(self) -> SerialChain | None:
        """The arm's axes and links; None for black-box kinematics."""
        return self._axes

    @property
    def chain(self) -> SerialChain:
        """The arm's axes and links, for methods that require them.

        Raises:
            InvalidProblem: The arm has black-box kinematics; `mechanism` is available, and `axes` is None.
        """
        return self._require_axes("a chain is made of axes and links")

    @property
    def structure(self) -> Structure:
        """Which of its axes intersect or are parallel, how exactly, and the resulting method: a word and a sentence.

        If this gives a closed form, `branches` does not search. If it gives one once a joint is fixed, `ik` seldom searches.
        """
        axes = self._axes
        return FUNCTION if axes is None else structure_of(axes.arrays, axes.length)

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
        """Kind of each joint: ``"revolute"``, ``"continuous"``, ``"prismatic"``, or ``"number"`` in black-box kinematics."""
        return self._mechanism.kinds

    @property
    def base(self) -> str:
        """Name of the link in which poses are given."""
        return self._mechanism.base

    @property
    def tip(self) -> str:
        """Name of the link whose pose is controlled, or that carries the tool of `with_tool`."""
        return self._mechanism.tip

    @property
    def lower(self) -> Array:
        """Lower limits, (n,), [rad] or [m].

        A continuous joint has no limits: its lower and upper values are -π and π, the turn in which solutions lie unless
        `near` selects another.
        """
        return self._mechanism.lower.copy()

    @property
    def upper(self) -> Array:
        """Upper limits, (n,), [rad] or [m]; see `lower`."""
        return self._mechanism.upper.copy()

    @property
    def velocity(self) -> Array:
        """Speed limits from the robot's file, (n,), [rad/s] or [m/s]; NaN where the file has no limit above 0.

        A URDF gives it in ``<limit velocity=…>``, where 0 means that the speed is unknown. MJCF, Denavit-Hartenberg rows and
        black-box kinematics cannot specify it, `with_limits` can. The limit of a joint that others mimic takes their speed
        limits into account.
        """
        return self._mechanism.velocity.copy()

    @property
    def acceleration(self) -> Array:
        """Acceleration limits, (n,), [rad/s²] or [m/s²], in both directions; NaN where none is known.

        They come from the joint_limits.yaml of `kinseek.load(..., limits=)`, from `with_limits`, or from the
        ``<limit acceleration=… deceleration=…>`` of URDF 1.2. Most robot files have none.
        """
        return self._mechanism.acceleration.copy()

    @property
    def jerk(self) -> Array:
        """Jerk limits, (n,), [rad/s³] or [m/s³]; NaN where none is known. They have the sources of `acceleration`."""
        return self._mechanism.jerk.copy()

    @property
    def states(self) -> dict[str, dict[str, float]]:
        """The named joint values of the SRDF that was given to `kinseek.load`; empty without one.

        Each is a mapping from the names of joints to values, [rad] or [m], and is accepted wherever joint values are, as in
        ``arm.fk(arm.states["home"])``. They are the states of the group that was loaded; without a group, of all groups.
        A state has the joints of this arm that the file gives, which may be a part of them, and may lie outside the limits.
        """
        states = {} if self._axes is None else self._axes.states
        names = set(self.joint_names)
        return {
            state: {joint: value for joint, value in values.items() if joint in names}
            for state, values in states.items()
        }

    def sample(self, n: int, seed: int = 0) -> Rows:
        """Draw joint values uniformly from inside the limits; the same seed gives the same values.

        Args:
            n: Number of joint vectors.
            seed: An integer of at least 0.

        Returns:
            Joint values, (n, dof), [rad] or [m].

        Raises:
            InvalidProblem: `n` or `seed` is not an integer of at least 0, or the values would take more than 16 GiB.
        """
        rows = as_integer("n", n, 0, error=InvalidProblem)
        seed = as_integer("seed", seed, 0, _LARGEST_SEED, InvalidProblem)
        if rows * self.dof > MOST_NUMBERS:
            raise InvalidProblem(
                f"n must be at most {MOST_NUMBERS // self.dof:,} for {self.dof} joints, got {rows:,}: the joint values "
                f"would take {8 * rows * self.dof / 2**30:,.0f} GiB. Draw fewer at a time, each time with another seed"
            )
        lower, upper, random = self._mechanism.lower, self._mechanism.upper, np.random.default_rng(seed)
        within: Rows = np.empty((rows, self.dof))
        for part in chunks(rows):
            some = within[part]
            some[:] = random.uniform(lower, upper, some.shape)
            np.clip(some, lower, upper, out=some)  # Rounding may exceed a limit.
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
        """Return the pose of the tip, or of any link between base and tip, in the base.

        Args:
            q: Joint values, (..., n), [rad] or [m]; they may lie outside the limits. Or by name, in any order: a mapping
                from every joint of `joint_names` to its value or values, (...); or an object with ``name`` and ``position``
                such as a ROS JointState, whose unknown joints are ignored.
            link: Name of a link or joint between base and tip, including fixed ones. A joint stands for the frame that it
                moves; a name that both have stands for the link. By default the tip, moved to the tool of `with_tool` if
                there is one; ``link=arm.tip`` is the link that carries the tool.

        Returns:
            Transforms, (..., 4, 4), lengths in [m].

        Raises:
            InvalidProblem: A wrong shape, NaN or infinity, unknown or missing names, an unknown link, or a link of an arm
                with black-box kinematics.
            FailedKinematics: The arm has black-box kinematics, and its function fails.
        """
        joints = as_joints(self._mechanism, q)
        flat = np.ascontiguousarray(joints.reshape(-1, self.dof))
        if link is not None:
            chain = self._require_axes("fk(link=...) needs the links of an arm")
            if not isinstance(link, str) or link not in chain.frames:
                raise InvalidProblem(suggest(str(link), chain.frames, "link or joint"))
            arrays = chain.arrays_to(chain.frames[link])
            poses = in_chunks(lambda some: forward_many(arrays, some), flat)
            return poses.reshape(*joints.shape[:-1], 4, 4)
        return self._mechanism.forward(flat).reshape(*joints.shape[:-1], 4, 4)

    def jacobian(self, q: Joints) -> Array:
        """Return the geometric Jacobian of the tip (Siciliano et al. 2009, Sec. 3.1).

        Rows 0 to 2 are the velocity of the tip's origin, rows 3 to 5 the angular velocity, both along the axes of the base.
        So ``jacobian(q) @ dq`` is the twist of the tip for joint velocities ``dq``. The tip is the tool of `with_tool` if
        there is one. The column of a joint that others mimic includes their motion.

        Args:
            q: Joint values, (..., n), [rad] or [m], or by name as in `fk`; they may lie outside the limits.

        Returns:
            (..., 6, n), in [m/rad] and [rad/rad] for a revolute joint, in [m/m] and [rad/m] for a prismatic joint.

        Raises:
            InvalidProblem: A wrong shape, NaN or infinity, or an arm with black-box kinematics, whose derivatives are
                unknown.
        """
        chain = self._require_axes("a Jacobian is worked out from axes")
        joints = as_joints(self._mechanism, q)
        flat = np.ascontiguousarray(joints.reshape(-1, self.dof))
        J = in_chunks(lambda some: jacobian_many(chain.arrays, some), flat)
        return J.reshape(*joints.shape[:-1], 6, self.dof)

    def manipulability(self, q: Joints) -> Any:
        """Return the manipulability: the product of the Jacobian's singular values (Yoshikawa 1985, eq. 4).

        It is √det(J Jᵀ) if the arm can move in all six directions. If an arm can do so nowhere, such as a planar arm, only
        as many singular values count as can be positive anywhere. As in the paper, metres and radians are mixed, so compare
        only values of one arm.

        Args:
            q: Joint values, (..., n), [rad] or [m], or by name as in `fk`; they may lie outside the limits.

        Returns:
            At least 0, and 0 at a singularity; a float, or an array (...).

        Raises:
            InvalidProblem: As `jacobian`.
        """
        J = self.jacobian(q)
        rank = self.dof - freedom(Problem(self._mechanism, Goal.pose(np.eye(4))))
        flat = J.reshape(-1, 6, self.dof)
        values = in_chunks(lambda some: np.linalg.svd(some, compute_uv=False)[:, :rank].prod(axis=-1), flat)
        return values.reshape(J.shape[:-2]) if J.ndim > 2 else float(values[0])

    def with_locked(self, values: Mapping[str, float]) -> Self:
        """Return the arm with some joints locked; its `q` holds only the remaining joints.

        Args:
            values: Value of each joint to lock, [rad] or [m]. Joints that mimic it are locked with it.

        Raises:
            InvalidRobot: Unknown joints, values that are not numbers or are outside the limits, or every joint locked.
        """
        return self._with(with_locked(self._require_axes("joints are locked along axes"), values))

    def with_limits(
        self,
        limits: Mapping[str, tuple[float, float]] | None = None,
        *,
        velocity: ArrayLike | Mapping[str, float] | None = None,
        acceleration: ArrayLike | Mapping[str, float] | None = None,
        jerk: ArrayLike | Mapping[str, float] | None = None,
    ) -> Self:
        """Return the arm with narrower limits, and with limits that its file does not have.

        Args:
            limits: Lower and upper limit of each joint to narrow, [rad] or [m]. A continuous joint takes any limits up to a
                full turn apart.
            velocity: Speed limits [rad/s] or [m/s]: one number, one for each joint, (n,), or a mapping from some joints to
                numbers. A joint without a limit takes any.
            acceleration: Acceleration limits [rad/s²] or [m/s²], in the same form.
            jerk: Jerk limits [rad/s³] or [m/s³], in the same form.

        Raises:
            InvalidRobot: Unknown joints, limits that are not numbers, inverted, not above 0, or wider than those of the arm.
        """
        rates = {"velocity": velocity, "acceleration": acceleration, "jerk": jerk}
        return self._with(with_limits(self._mechanism, {} if limits is None else limits, rates))

    def with_tool(self, tool: Any) -> Self:
        """Return the arm with its tip moved to a tool: `fk` and goals then refer to the tool.

        Args:
            tool: T_tip_tool, (4, 4), or an object that carries one, lengths in [m].

        Raises:
            InvalidGoal: Not one pose.
        """
        chain = self._require_axes("a tool is fixed to the last link of an arm")
        return self._with(with_tool(chain, one_pose(tool, "tool")))

    def _require_axes(self, why: str) -> SerialChain:
        """Return the axes and links, or raise an error for black-box kinematics; `why` names the feature that needs them."""
        if self._axes is None:
            raise InvalidProblem(no_axes(self._mechanism, why))
        return self._axes

    def _repr_html_(self) -> str:
        """HTML for notebooks: the joints, and a picture in the middle of their limits."""
        from .notebook.cards import arm_card

        return arm_card(self)

    def __repr__(self) -> str:
        """Name, joints and frames, whether it carries a tool, and which joints are locked."""
        tool = " + tool" if self._axes is not None and self._axes.tooled else ""
        locked = () if self._axes is None else self._axes.locked
        where = "".join(f", {printable(name)} locked at {value:.6g}" for name, value in locked)
        joints = f"{self.dof} joint{'s' if self.dof > 1 else ''}"
        return f"{type(self).__name__}({self.name!r}, {joints}, {self.base!r} -> {self.tip!r}{tool}{where})"
