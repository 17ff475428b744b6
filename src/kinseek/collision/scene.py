"""A scene: an arm, its obstacles, and collision checks at joint values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Never, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem, InvalidScene, suggest
from kinseek.kernels.collision.gaps import DOUBT, FREE
from kinseek.problem import as_joints
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import Mechanism
from kinseek.support.deadline import Deadline
from kinseek.support.validation import arrays_equal, as_flag, as_float_array, as_integer, as_number
from kinseek.timing.obstacles import unchanged
from kinseek.timing.trajectory import Trajectory
from kinseek.unknown_arguments import unknown_argument

from .assembly import Assembly, digest
from .bodies import arm_bodies, chain_of, package_folders
from .contents import Contents, read_missing
from .engine import TOUCH, Engine, Near
from .geometry import library
from .margins import Margins
from .motion import FINEST, are_free, stops, surely_hits
from .pairs import NEIGHBOURS, Contact, disabled_by, key, pairs_of
from .shapes import length_or_zero
from .together import Timed, free_until, speeds_of_both

if TYPE_CHECKING:
    from kinseek.goal import Goal
    from kinseek.paths.path import Path as Motion

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOST_SAMPLES = 1_000_000
"""Maximum number of samples of one motion, or of random joint values: a kernel that nothing interrupts checks some millions
in a second."""


class Nearest(NamedTuple):
    """The two bodies that are nearest to each other, among all checked pairs."""

    a: str
    b: str
    distance: float
    """Distance [m], negative if they penetrate."""
    point_a: Array
    """Nearest point on the first, in the base of the arm, (3,) [m], without padding and the radius of a cloud's points."""
    point_b: Array


class Scene(Contents):
    """An arm and its obstacles, for collision checks. Make one with `Scene.of`.

    Bodies have names: those of the arm are the names of its links, the others are given when they are added. Poses are in
    the base of the arm. A scene belongs to one arm, with the joints locked that were locked when it was made; its limits and
    tool may differ. Threads may share it while one of them changes it: each call takes the bodies as they are when it
    begins. Calls of coal wait for each other; a copy, `copy.copy(scene)`, is independent.
    """

    @classmethod
    def of(
        cls,
        arm: Any,
        meshes: Iterable[str | Path] | Mapping[str, str | Path] | Literal["skip"] = (),
        srdf: str | Path | None = None,
        padding: float = 0.0,
        capsules: float | None = None,
        *,
        urdf: str | Path | None = None,
        joints: Mapping[str, float] | None = None,
        missing: Literal["error", "skip"] = "error",
        samples: int = 1000,
        never: Literal["check", "skip"] = "check",
        trusted: bool = True,
    ) -> Self:
        """Make the scene of an arm without obstacles.

        Args:
            arm: An `Arm`, or anything that `kinseek.load` takes.
            meshes: Folders of the packages that ``package://`` addresses in the file name: packages, folders of packages, or
                a mapping from names to folders. ``"skip"`` is short for ``missing="skip"``.
            srdf: An SRDF file, or its text, whose disabled pairs are not checked; by default the one that the arm was loaded
                with.
            padding: Added to every shape of the arm on every side [m].
            capsules: For an arm whose file has no collision elements: the radius of capsules that replace its links [m].
            urdf: The file with the geometry, or its text, if the arm was not loaded from it.
            joints: Values of joints of the file that are not the arm's, such as a gripper's, by name, [rad] or [m]. The
                others are at 0, or at the limit nearest to it.
            missing: How to treat a mesh that cannot be read: ``"error"``, or ``"skip"``, which leaves it out and reports it
                in `notes`.
            samples: Number of random joint values inside the limits that determine which links always touch each other.
            never: How to treat links that touch at none of these: ``"check"`` checks them; ``"skip"`` leaves them out, as
                MoveIt's assistant does. This is faster, but samples cannot prove that it is right.
            trusted: May Python evaluate the expressions of a xacro file that is given as `urdf`, `srdf` or `arm`? An arm
                that is loaded already has the text of its file.

        Raises:
            InvalidScene: No geometry and no `capsules`; a mesh that is missing, empty or broken; folders, an SRDF or joints
                that do not fit; an arm with more than 150 moving joints.
            InvalidProblem: The arm has black-box kinematics.
            MissingExtra: pinocchio or trimesh is not installed.

        Warns:
            UnitWarning: A link extends farther than ten times the arm's reach.
        """
        library("pinocchio")
        trusted = as_flag("trusted", trusted, InvalidScene)
        chain = chain_of(arm, trusted)
        meshes, skip = read_missing(meshes, missing)
        if never not in ("check", "skip"):
            raise InvalidScene(suggest(str(never), ("check", "skip"), "value of never"))
        samples = as_integer("samples", samples, 1, MOST_SAMPLES, InvalidScene)
        padding = length_or_zero("padding", padding)
        if not isinstance(joints, Mapping | None):
            raise InvalidScene(f"joints must be a mapping from names to values, got {joints!r:.80}")
        folders = package_folders(meshes)
        found = arm_bodies(chain, folders, capsules, urdf, dict(joints or {}), skip, trusted)
        for body in found.bodies:
            body.padding = padding
        left_out = {key(a, b): NEIGHBOURS for a, b in found.neighbours}
        if (pairs := chain.srdf if srdf is None else srdf) is not None:
            disabled, notes = disabled_by(pairs, found, trusted)
            left_out, found.notes = disabled | left_out, [*found.notes, *notes]
        scene = cls(chain, found, left_out, samples)
        scene._sample(samples, never == "skip")
        if found.bodies:
            scene._warn_if_far(found.bodies)
        return scene

    def free(self, q: Any, clearance: float = 0.0, threads: int | None = None) -> Any:
        """Return whether every checked pair is farther apart than a clearance.

        Args:
            q: Joint values, (..., n), [rad] or [m], or by name as in `Arm.fk`.
            clearance: Minimum distance [m], at least 0.
            threads: Number of threads that share the rows of a large batch; None uses every core.

        Returns:
            bool, or (...) bool. Bodies closer than a thousandth of a millimetre touch.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: `clearance` is not a length.
            InvalidSolver: `threads` is not an integer of at least 1.
        """
        if type(q) is np.ndarray and type(clearance) is float and clearance == 0.0 and threads is None:
            # The short way; NaN and far joint values are in doubt.
            verdict = self._engine.verdict(q)
            if verdict != DOUBT:
                return verdict == FREE
        joints = as_joints(self._chain, q)
        least = length_or_zero("clearance", clearance)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        free = self._engine.free(joints.reshape(-1, self._chain.dof), least, threads)
        return free.reshape(joints.shape[:-1]) if joints.ndim > 1 else bool(free[0])

    def distance(self, q: Any) -> Any:
        """Return the distance of the two nearest bodies, among all checked pairs.

        Args:
            q: As in `free`.

        Returns:
            [m], float or (...), negative if bodies penetrate; infinite without pairs.

        Raises:
            InvalidProblem: `q` does not fit the arm.
        """
        joints = as_joints(self._chain, q)
        engine = self._engine
        with engine.lock:
            found = [engine.nearest(row) for row in joints.reshape(-1, self._chain.dof)]
        distances = np.array([np.inf if near is None else near.distance for near in found])
        return distances.reshape(joints.shape[:-1]) if joints.ndim > 1 else float(distances[0])

    def nearest(self, q: Any) -> Nearest:
        """Return the two nearest bodies at one q, (n,), their distance, and the nearest points.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: No pair is checked.
        """
        near = _nearest(self._made, self._one(q))
        if near is None:
            raise InvalidScene("no pair of bodies is checked, so there is no nearest pair")
        return near

    def hits(self, q: Any, clearance: float = 0.0) -> tuple[Contact, ...]:
        """Return the pairs that touch at one q, (n,), or are closer than a clearance [m], the deepest first.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: `clearance` is not a length.
        """
        return _hits(self._made, self._one(q), length_or_zero("clearance", clearance))

    def free_motion(
        self, q0: Any, q1: Any, clearance: float = 0.0, around: Any = None, thorough: bool = True
    ) -> Any:
        """Return whether every q of the linear motion between two joint values is free of collision.

        The result is proved by bounds on the motion of links and on distances, not by samples. A motion that comes within a
        hundredth of a millimetre of contact, or of the clearance, is not reported as free.

        Args:
            q0: Joint values, (..., n), [rad] or [m], or by name.
            q1: The other ends, in the same form; a continuous joint moves linearly, including full turns.
            clearance: Minimum distance of bodies along the motion [m].
            around: How far each joint may deviate from the linear motion on the way, (..., n), at least 0: every motion
                that stays this close to it is then free, for example a curved one.
            thorough: False does not report motions as free along which bodies nearly touch for long. Their proofs take up
                to a hundred times as long as others.

        Returns:
            bool, or (...) bool.

        Raises:
            InvalidProblem: `q0`, `q1` or `around` does not fit the arm, or they do not fit each other; or `thorough` is
                neither True nor False.
            InvalidScene: `clearance` is not a length.
        """
        starts, way, shape = self._ways(q0, q1)
        deviation = None if around is None else self._around(around, len(starts))
        least, thorough, made = (
            length_or_zero("clearance", clearance),
            as_flag("thorough", thorough),
            self._made,
        )
        with made.engine.lock:
            free = are_free(made.speeds, starts, starts + way, least, deviation, thorough)
        return free.reshape(shape) if shape else bool(free[0])

    def free_samples(self, q0: Any, q1: Any, counts: Any, clearance: float = 0.0) -> Any:
        """Return how many samples of linear motions are free before the first that is not; `free_motion` proves them all.

        Args:
            q0: Joint values at the begins, before the first samples, (k, n) [rad] or [m].
            q1: Joint values at the ends, which are the last samples, (k, n).
            counts: Number of samples of each motion, evenly spaced, (k,) of integers from 1 to 1,000,000.
            clearance: Minimum distance of bodies [m].

        Returns:
            (k,) integers, from 0 to `counts`.

        Raises:
            InvalidProblem: `q0` or `q1` does not fit the arm, or the arrays do not fit each other.
            InvalidScene: `clearance` is not a length.
        """
        starts, way, shape = self._ways(q0, q1)
        numbers = np.asarray(counts)
        whole = numbers.shape == shape and numbers.dtype.kind == "i"
        if not whole or not ((numbers >= 1) & (numbers <= MOST_SAMPLES)).all():
            raise InvalidProblem(
                f"counts must be integers from 1 to {MOST_SAMPLES:,} of shape {shape}, got {numbers!r}"
            )
        least = length_or_zero("clearance", clearance)
        return self._engine.free_samples(starts, way, numbers.astype(np.int64).ravel(), least).reshape(shape)

    def hits_between(self, q0: Any, q1: Any, clearance: float = 0.0) -> tuple[Contact, ...]:
        """Return the pairs that touch, or are too close, at one q of the linear motion between two, (n,) each.

        It is empty if `free_motion` is true. A pair that comes within a hundredth of a millimetre of contact, or of the
        clearance, counts.

        Raises:
            InvalidProblem: `q0` or `q1` does not fit the arm.
            InvalidScene: `clearance` is not a length.
        """
        starts, way, _ = self._ways(self._one(q0), self._one(q1))
        least, made = length_or_zero("clearance", clearance), self._made
        with made.engine.lock:
            if are_free(made.speeds, starts, starts + way, least)[0]:
                return ()
            (stop,) = stops(made.speeds, starts, starts + way, least)
            if np.isnan(stop):
                return ()
            q = starts[0] + stop * way[0]
            if found := _hits(made, q, least + FINEST + TOUCH):
                return found
            near = _nearest(made, q)  # Too near for too long to be separable.
        return () if near is None else (Contact(near.a, near.b, -near.distance),)

    def _ways(self, q0: Any, q1: Any) -> tuple[Array, Array, tuple[int, ...]]:
        """Return the starts of motions, (k, n), the motion of each joint, (k, n), and the shape of the batch."""
        ends = [as_joints(self._chain, q, name) for q, name in ((q0, "q0"), (q1, "q1"))]
        try:
            one, other = np.broadcast_arrays(*ends)
        except ValueError:
            raise InvalidProblem(
                f"q0 and q1 have shapes that do not broadcast: {ends[0].shape} and {ends[1].shape}"
            ) from None
        a, b = one.reshape(-1, self._chain.dof), other.reshape(-1, self._chain.dof)
        return a, b - a, one.shape[:-1]

    def _around(self, around: Any, count: int) -> Array:
        """Read how far joints may deviate from motions, (..., n), as (count, n)."""
        rows = as_joints(self._chain, around, "around").reshape(-1, self._chain.dof)
        if len(rows) not in (1, count) or (rows < 0.0).any():
            raise InvalidProblem(
                f"around must be one deviation of each joint for each of the {count} motions, at least 0, got {around!r:.80}"
            )
        return np.broadcast_to(rows, (count, self._chain.dof))

    def plan(
        self,
        q0: Any,
        goal: Any,
        time_limit: float | None = None,
        smooth: bool = True,
        clearance: float = 0.0,
        along: Goal | None = None,
        **unknown: Never,
    ) -> Motion:
        """Plan a motion around the obstacles, from joint values to a goal; it is proved free along its whole length.

        Between the rows of the path the joints move linearly, and `free_motion` is true for each of these motions. The
        limits are those of the arm of which the scene was made. The same call returns the same bits unless the time limit
        ends it.

        Args:
            q0: Joint values at the start, (n,), [rad] or [m], or by name as in `Arm.fk`.
            goal: Joint values, (n,) or by name; a pose, (4, 4), or an object that carries one; or a `Goal`. Several of
                them, of which one is reached: a list, joint values (k, n), poses (..., 4, 4), or a `Goal` with several
                targets. All solutions of a pose or `Goal` are ends; if the arm is redundant, a sample of them.
            time_limit: [s], after which the best way so far is returned.
            smooth: Shorten the way, and round its corners. False returns the first way that is found.
            clearance: Minimum distance of bodies along the way [m].
            along: A goal with one target, free axes and ranges, that holds at every row of the path, and nearly in between:
                ``Goal.pose(T, free=("x", "y", "z", "rz"))`` keeps the tool upright.

        Returns:
            The path, for `Path.timed`; its poses are those of its joint values. Joints without limits turn the shorter way
            round. If no way is found, it has the begin, the nearest end and a break between them. The status is then
            OUT_OF_TIME, or BROKEN after as many samples as are tried without a time limit. This does not prove that there
            is no way.

        Raises:
            InvalidProblem: Joint values that are not n finite numbers inside the limits; `q0`, or all joint values given as
                goals, are in collision; `q0` or the goal does not fulfil `along`, or that has several targets; `smooth` is
                not a bool.
            InvalidGoal: Not a pose.
            NotReached: No goal has a solution, or each solution found collides; the error carries a solution, whose
                `status` says whether this is proved and whose `contacts` are what the arm hits.
            InvalidScene: `clearance` is not a length, or another thread changed the scene during the call.
        """
        if unknown:
            raise unknown_argument(Scene.plan, unknown)
        from kinseek.planning.plan import plan

        from .ends import free_begin, free_ends

        smooth = as_flag("smooth", smooth)
        deadline, least = Deadline(time_limit), length_or_zero("clearance", clearance)
        with unchanged(self, "plan"):
            begin = free_begin(self, q0, least)
            ends = free_ends(self, begin, goal, least, deadline)
            return plan(
                self._chain, self, begin, ends, smooth=smooth, clearance=least, deadline=deadline, along=along
            )

    def free_until(
        self,
        trajectory: Trajectory,
        others: Mapping[str, Trajectory],
        clearance: float = 0.0,
        delay: float = 0.0,
    ) -> float:
        """Return the time up to which this arm is proved free of other arms that move at the same time.

        Each arm rests at the begin of its trajectory before it, and at its end after it. All pairs of a link of this arm, or
        a body attached to it, and one of another arm are checked. A trajectory that was timed in the scene of its own arm
        is free of everything that rests there.

        Args:
            trajectory: Motion of this arm, of `Path.timed` or `Arm.move`.
            others: Motions of other arms of the scene, by their names in `add_arm`; they begin at time 0.
            clearance: Minimum distance of bodies [m].
            delay: Time at which this arm begins to move [s].

        Returns:
            The time [s]; infinite if all arms are free of each other at all times. Motions that come within a hundredth of a
            millimetre of contact, or of the clearance, are not free.

        Raises:
            InvalidProblem: A trajectory does not belong to its arm, or `delay` is not a time of at least 0.
            InvalidScene: `others` names no arm of the scene, `clearance` is not a length, or another thread changed the
                scene during the call.
        """
        least, begin = (
            length_or_zero("clearance", clearance),
            as_number("delay", delay, 0.0, 1e6, InvalidProblem),
        )
        one = Timed(_trajectory_of(self._chain, "trajectory", trajectory), begin)
        if not isinstance(others, Mapping) or not others:
            raise InvalidScene(
                f"others must map names of arms of the scene to their trajectories, got {others!r:.80}"
            )
        found = np.inf
        with unchanged(self, "free_until"):
            made = self._made
            for name, motion in others.items():
                standing = self._others  # Another thread may remove an arm.
                self._require(name, standing, "arm of the scene")
                arm = standing[name]
                other = Timed(_trajectory_of(arm.chain, f"others[{name!r}]", motion), 0.0)
                if name not in made.both:
                    bodies, never = self._now()
                    links = [body for body in bodies if body.of_arm]
                    made.both[name] = speeds_of_both(self._chain, links, arm, never)
                found = min(found, free_until(made.both[name], one, other, least))
        return found

    def hits_around(self, q: Any, reach: Any, clearance: float = 0.0) -> bool:
        """Return whether bodies certainly touch, or are too close, wherever no joint is farther than `reach` from q.

        Args:
            q: Joint values, (n,), [rad] or [m], or by name.
            reach: Maximum deviation of each joint, (n,), [rad] or [m].
            clearance: Minimum distance of bodies [m].

        Returns:
            True if one pair touches or is too close in the whole range. False has no meaning.

        Raises:
            InvalidProblem: `q` or `reach` does not fit the arm.
            InvalidScene: `clearance` is not a length.
        """
        joints, least = self._one(q), length_or_zero("clearance", clearance)
        try:
            around = np.broadcast_to(as_float_array(reach), joints.shape)
        except (TypeError, ValueError, OverflowError) as error:
            raise InvalidProblem(f"reach must be {len(joints)} numbers, got {reach!r:.80}: {error}") from None
        if not (around >= 0.0).all():  # Also of NaN.
            raise InvalidProblem(f"reach must be at least 0, got {reach!r:.80}")
        made = self._made
        with made.engine.lock:
            return surely_hits(made.speeds, joints, around, least)

    @property
    def margins(self) -> Margins:
        """Bounds of distances for the current contents; another object after every change of them."""
        made, known = self._made, self._margins
        broad = made.engine.broad
        if known is None or known.broad is not broad:
            self._margins = known = Margins(made, broad)
        return known

    def fits(self, mechanism: Mechanism) -> bool:
        """Return whether this is the scene of an arm. The arm's limits and tool may differ."""
        return _same_arm(mechanism.axes, self._chain)

    @property
    def digest(self) -> str:
        """Digest of everything besides the arm that results depend on: shapes, poses, padding, and checked pairs."""
        bodies, never = self._now()
        return digest(bodies, pairs_of(bodies, never))

    def _repr_html_(self) -> str:
        """The bodies and a picture, for notebooks."""
        from kinseek.notebook.cards import scene_card

        from .surfaces import bodies_hit, outlines

        q = (self._chain.lower + self._chain.upper) / 2
        return scene_card(self, self._chain, q, outlines(self, q), bodies_hit(self, q[None]))

    @property
    def _engine(self) -> Engine:
        """The engine of the current scene."""
        return self._made.engine


def _nearest(made: Assembly, q: Array) -> Nearest | None:
    """Return the two bodies that are nearest to each other at q, (n,); None without pairs."""
    with made.engine.lock:
        near = made.engine.nearest(q)
    return None if near is None else Nearest(*made.owners[near.pair], near.distance, *near.points)


def _hits(made: Assembly, q: Array, clearance: float) -> tuple[Contact, ...]:
    """Return the pairs of bodies that touch at q, (n,), or are closer than a clearance, the deepest first."""
    found: dict[tuple[str, str], Near] = {}
    with made.engine.lock:
        for near in made.engine.touching(q, clearance):
            names = made.owners[near.pair]
            if names not in found or near.distance < found[names].distance:
                found[names] = near
    contacts = [Contact(a, b, -near.distance) for (a, b), near in found.items()]
    return tuple(sorted(contacts, key=lambda contact: -contact.depth))


def _same_arm(chain: SerialChain | None, own: SerialChain) -> bool:
    """Return whether two chains have the same joints and links; limits and tools may differ."""
    return (
        chain is not None
        and chain.joint_names == own.joint_names
        and chain.fixed.shape == own.fixed.shape
        and arrays_equal(chain.fixed[:-1], own.fixed[:-1])
        and arrays_equal([chain.leader, chain.prismatic], [own.leader, own.prismatic])
        and arrays_equal([chain.multiplier, chain.offset], [own.multiplier, own.offset])
    )


def _trajectory_of(chain: SerialChain, name: str, trajectory: Any) -> Trajectory:
    """Read a trajectory of an arm.

    Raises:
        InvalidProblem: It is none, or that of another arm.
    """
    if not isinstance(trajectory, Trajectory):
        raise InvalidProblem(
            f"{name} must be a trajectory, such as path.timed() returns, got {type(trajectory).__name__}"
        )
    if not _same_arm(trajectory.mechanism.axes, chain):
        raise InvalidProblem(
            f"{name} is a motion of {trajectory.mechanism.name!r}, expected one of {chain.name!r} with joints "
            f"{', '.join(chain.joint_names)}"
        )
    return trajectory
