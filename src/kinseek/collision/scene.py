"""A scene: an arm, what stands around it, and which of these touch at joint values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem, InvalidScene, suggest
from kinseek.problem import as_joints
from kinseek.robots.mechanism import Mechanism
from kinseek.validation import arrays_equal, as_integer

from .assembly import digest
from .bodies import arm_bodies, chain_of, package_folders
from .contents import Contents, read_missing
from .engine import TOUCH, Engine, Near
from .motion import FINEST, stops, surely_hits
from .pairs import NEIGHBOURS, Contact, disabled_by, key
from .shapes import length_or_zero, library

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Nearest(NamedTuple):
    """The two bodies that are nearest to each other, of all pairs that count."""

    a: str
    b: str
    distance: float
    """[m], negative where they are in each other."""
    point_a: Array
    """On the first, in the base of the arm, (3,) [m]; padding and the radius of a cloud's points are not in it."""
    point_b: Array


class Scene(Contents):
    """An arm and what it may hit. Make one with `Scene.of`.

    Bodies have names: those of the arm are called as its links, the others as they were added. Poses are in the base of the
    arm. A scene belongs to one arm, with the joints locked that were locked when it was made; limits and tool may be others.
    Threads may share it, and wait for each other; a copy, `copy.copy(scene)`, goes its own way.
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
    ) -> Self:
        """Make the scene of an arm by itself.

        Args:
            arm: An `Arm`, or what `kinseek.load` takes.
            meshes: Folders of the packages that ``package://`` addresses of the file name: packages, folders of packages, or
                a mapping from names to folders. ``"skip"`` is short for ``missing="skip"``.
            srdf: An SRDF file, or its text, whose disabled pairs never count.
            padding: Added to every shape of the arm on every side [m].
            capsules: For an arm whose file has no collision elements: the radius of capsules that stand in for links [m].
            urdf: The file with the geometry, or its text, where it is not the one that the arm was loaded from.
            joints: Values of joints of the file that are not the arm's, a gripper's for example, by name, [rad] or [m]; the
                others stand at 0, or at the limit nearest to it.
            missing: What to do about a mesh that cannot be read: ``"error"``, or ``"skip"``, which leaves it out and says so
                in `notes`.
            samples: At how many random joint values inside the limits it is looked which links always touch each other.
            never: What to do about links that touch at none of these: ``"check"`` looks at them all the same; ``"skip"``
                leaves them out, as MoveIt's assistant does, which is faster, and which samples cannot prove right.

        Raises:
            InvalidScene: No geometry and no `capsules`; a mesh that is missing, empty or broken; folders, an SRDF or joints
                that do not fit.
            InvalidProblem: The arm is a function.
            MissingExtra: pinocchio or trimesh is not installed.
        """
        library("pinocchio")
        chain = chain_of(arm)
        meshes, skip = read_missing(meshes, missing)
        if never not in ("check", "skip"):
            raise InvalidScene(suggest(str(never), ("check", "skip"), "value of never"))
        samples = as_integer("samples", samples, 1, error=InvalidScene)
        padding = length_or_zero("padding", padding)
        if not isinstance(joints, Mapping | None):
            raise InvalidScene(f"joints must be a mapping from names to values, got {joints!r:.80}")
        found = arm_bodies(chain, package_folders(meshes), capsules, urdf, dict(joints or {}), skip)
        for body in found.bodies:
            body.padding = padding
        left_out = {key(a, b): NEIGHBOURS for a, b in found.neighbours}
        if srdf is not None:
            disabled, notes = disabled_by(srdf, found)
            left_out, found.notes = disabled | left_out, [*found.notes, *notes]
        scene = cls(chain, found, left_out, samples)
        scene._sample(samples, never == "skip")
        return scene

    def free(self, q: Any, clearance: float = 0.0, threads: int | None = None) -> Any:
        """Is every pair that counts farther apart than a clearance?

        Args:
            q: Joint values, (..., n), [rad] or [m], or by name as `Arm.fk` takes them.
            clearance: [m], at least 0.
            threads: That share the rows of a large batch; None takes every core.

        Returns:
            bool, or (...) bool. What is closer than a thousandth of a millimetre touches.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: `clearance` is no length.
            InvalidSolver: `threads` is no whole number of at least 1.
        """
        joints = as_joints(self._chain, q)
        least = length_or_zero("clearance", clearance)
        if threads is not None:
            threads = as_integer("threads", threads, 1)
        free = self._asked.free(joints.reshape(-1, self._chain.dof), least, threads)
        return free.reshape(joints.shape[:-1]) if joints.ndim > 1 else bool(free[0])

    def distance(self, q: Any) -> Any:
        """Distance of the two bodies that are nearest to each other, of all pairs that count.

        Args:
            q: As in `free`.

        Returns:
            [m], float or (...), negative where bodies are in each other; infinite without pairs.

        Raises:
            InvalidProblem: `q` does not fit the arm.
        """
        joints = as_joints(self._chain, q)
        with self._asked as engine:
            found = [engine.nearest(row) for row in joints.reshape(-1, self._chain.dof)]
        distances = np.array([np.inf if near is None else near.distance for near in found])
        return distances.reshape(joints.shape[:-1]) if joints.ndim > 1 else float(distances[0])

    def nearest(self, q: Any) -> Nearest:
        """The two bodies that are nearest to each other at one q, (n,), how far they are apart, and where.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: No pair counts.
        """
        joints = self._one(q)
        with self._asked as engine:
            near = engine.nearest(joints)
        if near is None:
            raise InvalidScene("no pair of bodies counts, so none is nearest")
        (a, b), (point_a, point_b) = self._made.owners[near.pair], near.points
        return Nearest(a, b, near.distance, point_a, point_b)

    def hits(self, q: Any, clearance: float = 0.0) -> tuple[Contact, ...]:
        """The pairs of bodies that touch at one q, (n,), or are closer than a clearance [m], the deepest first.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: `clearance` is no length.
        """
        joints, least = self._one(q), length_or_zero("clearance", clearance)
        found: dict[tuple[str, str], Near] = {}
        with self._asked as engine:
            for near in engine.touching(joints, least):
                names = self._made.owners[near.pair]
                if names not in found or near.distance < found[names].distance:
                    found[names] = near
        contacts = [Contact(a, b, -near.distance) for (a, b), near in found.items()]
        return tuple(sorted(contacts, key=lambda contact: -contact.depth))

    def free_motion(self, q0: Any, q1: Any, clearance: float = 0.0) -> Any:
        """Is every q on the straight way between two free, every joint moving at its own constant speed?

        It is proved, by how far any point of a link can move and how far bodies are apart, not looked at in samples. A
        motion on which bodies come within a hundredth of a millimetre of touching, or of the clearance, is not called free.

        Args:
            q0: Joint values, (..., n), [rad] or [m], or by name.
            q1: The other ends, likewise; a continuous joint goes there straight, full turns too.
            clearance: How far apart bodies have to be all along [m].

        Returns:
            bool, or (...) bool.

        Raises:
            InvalidProblem: `q0` or `q1` does not fit the arm, or they do not fit each other.
            InvalidScene: `clearance` is no length.
        """
        starts, way, shape = self._ways(q0, q1)
        free = np.isnan(self._stops(starts, way, clearance))
        return free.reshape(shape) if shape else bool(free[0])

    def hits_between(self, q0: Any, q1: Any, clearance: float = 0.0) -> tuple[Contact, ...]:
        """What is in the way from one q to another, (n,) each: the pairs that touch, or are too close, at one q between.

        It is empty where `free_motion` is true. A pair that comes within a hundredth of a millimetre of touching, or of the
        clearance, counts.

        Raises:
            InvalidProblem: `q0` or `q1` does not fit the arm.
            InvalidScene: `clearance` is no length.
        """
        starts, way, _ = self._ways(self._one(q0), self._one(q1))
        (stop,) = self._stops(starts, way, clearance)
        if np.isnan(stop):
            return ()
        q = starts[0] + stop * way[0]
        if found := self.hits(q, clearance + FINEST + TOUCH):
            return found
        near = self.nearest(q)  # It was too near for too long to be told from touching.
        return (Contact(near.a, near.b, -near.distance),)

    def _ways(self, q0: Any, q1: Any) -> tuple[Array, Array, tuple[int, ...]]:
        """Where motions begin, (k, n), what each joint moves, (k, n), and the shape of all."""
        ends = [as_joints(self._chain, q, name) for q, name in ((q0, "q0"), (q1, "q1"))]
        try:
            one, other = np.broadcast_arrays(*ends)
        except ValueError:
            raise InvalidProblem(
                f"q0 and q1 do not fit: shapes {ends[0].shape} and {ends[1].shape}"
            ) from None
        a, b = one.reshape(-1, self._chain.dof), other.reshape(-1, self._chain.dof)
        return a, b - a, one.shape[:-1]

    def _stops(self, starts: Array, way: Array, clearance: float) -> Array:
        least = length_or_zero("clearance", clearance)
        with self._asked:
            return stops(self._made.speeds, starts, starts + way, least)

    def hits_around(self, q: Any, reach: Any, clearance: float = 0.0) -> bool:
        """Is it sure that bodies touch, or are too close, wherever no joint is farther than `reach` from q?

        Args:
            q: Joint values, (n,), [rad] or [m], or by name.
            reach: How far each joint may be off, (n,), [rad] or [m].
            clearance: How far apart bodies have to be [m].

        Returns:
            True where one pair does all over there. False says nothing.

        Raises:
            InvalidProblem: `q` does not fit the arm.
            InvalidScene: `clearance` is no length.
        """
        joints, least = self._one(q), length_or_zero("clearance", clearance)
        with self._asked:
            return surely_hits(self._made.speeds, joints, np.asarray(reach, dtype=np.float64), least)

    def fits(self, mechanism: Mechanism) -> bool:
        """Is this the scene of an arm? Its limits and its tool may be others."""
        chain, own = mechanism.axes, self._chain
        return (
            chain is not None
            and chain.joint_names == own.joint_names
            and chain.fixed.shape == own.fixed.shape
            and arrays_equal(chain.fixed[:-1], own.fixed[:-1])
            and arrays_equal(chain.leader, own.leader)
            and arrays_equal([chain.multiplier, chain.offset], [own.multiplier, own.offset])
        )

    @property
    def digest(self) -> str:
        """Of all that its answers depend on beside the arm: shapes, where they stand, padding, and which pairs count."""
        return digest(self._bodies.values(), self.pairs)

    @property
    def _asked(self) -> Engine:
        """The engine of the scene as it is now."""
        return self._made.engine
