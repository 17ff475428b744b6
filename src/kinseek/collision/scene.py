"""A scene: an arm, what stands around it, and which of these touch at joint values."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem, InvalidScene, suggest
from kinseek.poses import one_pose
from kinseek.problem import as_joints
from kinseek.robots.chain import Frame, SerialChain
from kinseek.robots.mechanism import Mechanism

from .bodies import ArmBodies, Body, Part, arm_bodies, chain_of, package_folders
from .engine import TOUCH, Engine, Near, Solid
from .motion import FINEST, Speeds, stops, surely_hits
from .others import OtherArm
from .pairs import ATTACHED, NEIGHBOURS, Contact, Pair, disabled_by, key, pairs_of
from .shapes import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere, length_or_zero, library

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


class Scene:
    """An arm and what it may hit. Make one with `Scene.of`.

    Bodies have names: those of the arm are called as its links, the others as they were added. Poses are in the base of the
    arm. A scene belongs to one arm, with the joints locked that were locked when it was made; limits and tool may be others.
    Threads may share it, and wait for each other; a copy, `copy.copy(scene)`, goes its own way.
    """

    def __init__(
        self, chain: SerialChain, arm: ArmBodies, never: dict[tuple[str, str], str], samples: int
    ) -> None:
        """Put together what `Scene.of` has read."""
        self._samples = samples
        self._chain, self._links = chain, arm.links
        self._bodies = {body.name: body for body in arm.bodies}
        self._never = never
        self._notes = list(arm.notes)
        self._engine: Engine | None = None
        self._owners: list[tuple[str, str]] = []
        self._numbers: dict[str, list[int]] = {}
        self._speeds: Speeds | None = None
        self._others: dict[str, OtherArm] = {}

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
        for name, value in (("missing", missing), ("never", never)):
            choices = {"missing": ("error", "skip"), "never": ("check", "skip")}[name]
            if value not in choices:
                raise InvalidScene(suggest(str(value), choices, f"value of {name}"))
        if isinstance(samples, bool) or not isinstance(samples, int) or samples < 1:
            raise InvalidScene(f"samples must be a whole number of at least 1, got {samples!r}")
        if isinstance(meshes, str) and meshes == "skip":
            meshes, missing = (), "skip"
        padding = length_or_zero("padding", padding)
        if not isinstance(joints, Mapping | None):
            raise InvalidScene(f"joints must be a mapping from names to values, got {joints!r:.80}")
        found = arm_bodies(chain, package_folders(meshes), capsules, urdf, dict(joints or {}), missing)
        for body in found.bodies:
            body.padding = padding
        left_out = {key(a, b): NEIGHBOURS for a, b in found.neighbours}
        if srdf is not None:
            disabled, notes = disabled_by(srdf, found)
            left_out, found.notes = disabled | left_out, [*found.notes, *notes]
        scene = cls(chain, found, left_out, samples)
        scene._sample(samples, never == "skip")
        return scene

    def add_box(self, name: str, size: ArrayLike, pose: Any = None) -> None:
        """Add a box.

        Args:
            name: Of the new body.
            size: Edges along its x, y and z [m].
            pose: Of its middle in the base of the arm, (4, 4), or an object that carries one; the base itself unless given.

        Raises:
            InvalidScene: A name that is taken, a size that is none.
            InvalidGoal: `pose` is none.
        """
        self.add(name, Box(size), pose)

    def add_sphere(self, name: str, radius: float, pose: Any = None) -> None:
        """Add a ball of a radius [m]; see `add_box`."""
        self.add(name, Sphere(radius), pose)

    def add_cylinder(self, name: str, radius: float, length: float, pose: Any = None) -> None:
        """Add a cylinder about the z axis of its pose, lengths in [m]; see `add_box`."""
        self.add(name, Cylinder(radius, length), pose)

    def add_capsule(self, name: str, radius: float, length: float, pose: Any = None) -> None:
        """Add a cylinder with round ends about the z axis of its pose; `length` [m] is without these; see `add_box`."""
        self.add(name, Capsule(radius, length), pose)

    def add_mesh(
        self,
        name: str,
        path: str | Path,
        pose: Any = None,
        *,
        scale: ArrayLike = 1.0,
        hull: bool = False,
        simplify: float | None = None,
    ) -> None:
        """Add what a file of triangles holds.

        A closed mesh is solid. One that is open is a surface: what lies wholly behind it does not touch it; `notes` says so.

        Args:
            name: Of the new body.
            path: An STL, OBJ or DAE file.
            pose: See `add_box`.
            scale: One factor, or one along each axis.
            hull: Take its convex hull: faster, and solid in any case.
            simplify: Fewer triangles, no point moved farther than this [m]; the body gets as much thicker, so that what is
                free of it is free of the mesh, and `notes` says by how much. Nothing is simplified otherwise.

        Raises:
            InvalidScene: As `add_box`, or the file is missing, empty or cannot be read; more than a million triangles
                without `hull` or `simplify`.
        """
        mesh = Mesh.read(path, scale, hull, simplify)
        self.add(name, mesh, pose)
        if simplify is not None:
            self._notes.append(
                f"{name!r} is simplified to {len(mesh.faces):,} triangles, and counts as {mesh.thicker:.2g} m thicker"
            )

    def add_points(self, name: str, cloud: ArrayLike, radius: float, pose: Any = None) -> None:
        """Add a cloud of points, (k, 3) [m], as a depth camera gives it; each is a ball of a radius [m]; see `add_box`.

        Raises:
            InvalidScene: As `add_box`, or NaN in the cloud; the message says how many points hold it.
        """
        self.add(name, Points(cloud, radius), pose)

    def add(self, name: str, shape: Shape, pose: Any = None) -> None:
        """Add a shape of `kinseek.collision`, as the other ways to add do.

        Raises:
            InvalidScene: A name that is taken, or no shape.
            InvalidGoal: `pose` is none.
        """
        self._enter(Body(self._new(name), Frame(0, np.eye(4)), [_part(shape, pose)]))
        if isinstance(shape, Mesh) and not shape.hull and not shape.closed:
            self._notes.append(
                f"{name!r} is an open mesh, a surface: what lies wholly behind it does not touch it"
            )

    def attach(
        self,
        name: str,
        shape: Shape,
        to: str,
        pose: Any = None,
        touches: Iterable[str] = (),
        padding: float = 0.0,
    ) -> None:
        """Attach a shape to a link: a tool, or what a gripper holds. It moves with the link, and may hit what the link may.

        As among links, pairs that touch at all of the scene's random joint values do not count; `pairs` names them.

        Args:
            name: Of the new body.
            shape: A `Box`, `Sphere`, `Cylinder`, `Capsule` or hull of a `Mesh` from `kinseek.collision`.
            to: A link of the file, with geometry or without.
            pose: Of the shape in the frame of that link, (4, 4), or an object that carries one; its frame unless given.
            touches: Names of bodies that it may touch, beside that link.
            padding: Added to it on every side [m].

        Raises:
            InvalidScene: A name that is taken, an unknown link or body, a shape that cannot be carried.
            InvalidGoal: `pose` is none.
        """
        if to not in self._links:
            raise InvalidScene(suggest(str(to), self._links, "link"))
        if isinstance(shape, Points) or (isinstance(shape, Mesh) and not shape.hull):
            raise InvalidScene(
                "what is attached must be convex: a cloud cannot be, of a mesh its hull, hull=True"
            )
        for other in touches:
            self._require(other)
        part = _part(shape, pose)
        frame = self._links[to]
        self._enter(
            Body(
                self._new(name),
                frame,
                [part],
                padding=length_or_zero("padding", padding),
            )
        )
        for other in {to, *touches} & self._bodies.keys():
            self._never[key(name, other)] = ATTACHED if other == to else "said: it may touch this"
        self._sample(self._samples, False, name)

    def add_arm(self, name: str, other: Scene, q: Any, pose: Any = None) -> None:
        """Add another arm as an obstacle that stands at joint values, until `move` puts it to others.

        Its links and what is attached to them are taken from its own scene, as they are now, with their padding; what stands
        around it is not. Their names here are ``name/link``. Whether the other arm hits itself is not looked at.

        Args:
            name: Of the other arm in this scene.
            other: The scene of the other arm; it may be of the same model.
            q: Joint values of the other arm, (m,), [rad] or [m], or by name.
            pose: Of the base of the other arm in the base of this one, (4, 4), or an object that carries one; the same base
                unless given.

        Raises:
            InvalidScene: A name that is taken, or no scene.
            InvalidProblem: `q` does not fit the other arm.
            InvalidGoal: `pose` is none.
        """
        if not isinstance(other, Scene):
            raise InvalidScene(
                f"expected the kinseek.Scene of the other arm, got {type(other).__name__}; make one: Scene.of(other_arm)"
            )
        base = np.eye(4) if pose is None else one_pose(pose, "pose")
        own = [body for body in other._bodies.values() if body.is_link or body.frame.joints]
        arm = OtherArm(self._new(name), other._chain, base, own)
        added = arm.at(other._one(q))
        for body in added:
            self._new(body.name)
        self._bodies |= {body.name: body for body in added}
        self._others[name], self._engine = arm, None

    def move(self, name: str, q: Any) -> None:
        """Put another arm of the scene to other joint values; nothing is built anew.

        Args:
            name: As it was added by `add_arm`.
            q: Its joint values, (m,), [rad] or [m], or by name.

        Raises:
            InvalidScene: No such arm.
            InvalidProblem: `q` does not fit it.
        """
        if name not in self._others:
            raise InvalidScene(suggest(str(name), self._others, "arm of the scene"))
        arm = self._others[name]
        moved = arm.at(one_q(arm.chain, q))
        self._bodies |= {body.name: body for body in moved}
        if self._engine is not None:
            with self._engine as engine:
                engine.stand(
                    {
                        number: body.frame.pose @ part.pose
                        for body in moved
                        for number, part in zip(self._numbers.get(body.name, ()), body.parts, strict=False)
                    }
                )

    def allow(self, a: str, b: str, reason: str = "said: they may touch") -> None:
        """Leave a pair of bodies out of what counts.

        Raises:
            InvalidScene: An unknown body.
        """
        self._require(a)
        self._require(b)
        self._never[key(a, b)] = str(reason) or "said: they may touch"
        self._engine = None

    def remove(self, name: str) -> None:
        """Take a body away that was added or attached, or another arm.

        Raises:
            InvalidScene: There is none, or it is a link of an arm.
        """
        if (other := self._others.pop(name, None)) is not None:
            for body in other.names:
                self.remove(body)
            return
        self._require(name)
        if owner := next((arm.name for arm in self._others.values() if name in arm.names), None):
            raise InvalidScene(
                f"{name!r} belongs to the arm {owner!r}; remove({owner!r}) takes all of it away"
            )
        if self._bodies[name].is_link:
            raise InvalidScene(
                f"{name!r} is a link of the arm; allow({name!r}, other) lets it touch another body"
            )
        del self._bodies[name]
        self._never = {pair: why for pair, why in self._never.items() if name not in pair}
        self._notes = [note for note in self._notes if not note.startswith(f"{name!r} ")]
        self._engine = None

    @property
    def arm(self) -> str:
        """The arm, for messages: its name and its joints."""
        return f"{self._chain.name!r} with joints {', '.join(self._chain.joint_names)}"

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all bodies: links of the arm with geometry, then what was added."""
        return tuple(self._bodies)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """All pairs of bodies, those that count and those that do not with the reason; each prints as a line."""
        return tuple(pairs_of(self._bodies.values(), self._never))

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out, what stands in for something, where joints stand that are not the arm's: a sentence each."""
        return tuple(self._notes)

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
        """
        joints = as_joints(self._chain, q)
        least = length_or_zero("clearance", clearance)
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
        (a, b), (point_a, point_b) = self._owners[near.pair], near.points
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
                names = self._owners[near.pair]
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
            return stops(self._known_speeds, starts, starts + way, least)

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
            return surely_hits(self._known_speeds, joints, np.asarray(reach, dtype=np.float64), least)

    def fits(self, mechanism: Mechanism) -> bool:
        """Is this the scene of an arm? Its limits and its tool may be others."""
        chain, own = mechanism.axes, self._chain
        return (
            chain is not None
            and chain.joint_names == own.joint_names
            and chain.fixed.shape == own.fixed.shape
            and np.array_equal(chain.fixed[:-1], own.fixed[:-1])
            and np.array_equal(chain.leader, own.leader)
            and np.array_equal([chain.multiplier, chain.offset], [own.multiplier, own.offset])
        )

    @property
    def _asked(self) -> Engine:
        """The engine of the scene as it is now."""
        if self._engine is None:
            self._engine, self._owners, self._numbers = self._make(self.pairs)
        return self._engine

    @property
    def _known_speeds(self) -> Speeds:
        """How fast bodies can move, kept with the engine."""
        engine = self._asked
        if self._speeds is None or self._speeds.engine is not engine:
            self._speeds = Speeds(self._chain, engine)
        return self._speeds

    def _make(self, pairs: Iterable[Pair]) -> tuple[Engine, list[tuple[str, str]], dict[str, list[int]]]:
        solids: list[Solid] = []
        numbers: dict[str, list[int]] = {}
        counting = [pair for pair in pairs if pair.counts]
        named = {name for pair in counting for name in (pair.a, pair.b)}
        for body in (body for body in self._bodies.values() if body.name in named):
            numbers[body.name] = list(range(len(solids), len(solids) + len(body.parts)))
            solids += [
                Solid(body.frame.joints, part.shape, body.frame.pose @ part.pose, body.padding)
                for part in body.parts
            ]
        counted = [
            ((i, j), (pair.a, pair.b)) for pair in counting for i in numbers[pair.a] for j in numbers[pair.b]
        ]
        engine = Engine(self._chain, solids, [pair for pair, _ in counted])
        return engine, [names for _, names in counted], numbers

    def _sample(self, samples: int, skip_never: bool, name: str | None = None) -> None:
        """Find pairs of what the arm carries that touch at all samples, or at none; of those of one body if it is named."""
        chain = self._chain
        q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (samples, chain.dof))
        carried = {body.name for body in self._bodies.values() if body.is_link or body.frame.joints}
        open_pairs = [pair for pair in self.pairs if pair.counts and {pair.a, pair.b} <= carried]
        open_pairs = [pair for pair in open_pairs if name in (None, pair.a, pair.b)]
        always = f"always: they touch at all of {samples:,} random joint values"
        none = f"never: they touch at none of {samples:,} random joint values"
        for pair in open_pairs:
            engine, _, _ = self._make([pair])
            if skip_never:
                count = samples - int(engine.exactly_free(q, 0.0).sum())
            else:  # The first sample at which they are apart ends it.
                count = next(
                    (i for i in range(samples) if engine.exactly_free(q[i : i + 1], 0.0)[0]), samples
                )
                count = samples if count == samples else 1
            if count == samples:
                self._never[key(pair.a, pair.b)] = always
            elif count == 0:
                self._never[key(pair.a, pair.b)] = none
        self._engine = None

    def _one(self, q: Any) -> Array:
        return one_q(self._chain, q)

    def _new(self, name: str) -> str:
        if not isinstance(name, str) or not name:
            raise InvalidScene(f"a body needs a name, got {name!r}")
        if name in self._bodies or name in self._links or name in self._others:
            if name in self._links:
                raise InvalidScene(f"{name!r} is a link of the arm already; names are unique")
            what = "an arm" if name in self._others else "a body"
            raise InvalidScene(
                f"{name!r} is {what} of the scene already; names are unique. remove({name!r}) takes it away"
            )
        return name

    def _require(self, name: str) -> None:
        if name not in self._bodies:
            raise InvalidScene(suggest(str(name), self._bodies, "body"))

    def _enter(self, body: Body) -> None:
        self._bodies[body.name] = body
        self._engine = None

    def __getstate__(self) -> dict[str, Any]:
        """Pickle and copy what it is made of; the engine is made anew."""
        state = {**self.__dict__, "_engine": None, "_speeds": None, "_owners": []}
        return state | {
            "_bodies": dict(self._bodies),
            "_others": dict(self._others),
            "_never": dict(self._never),
            "_notes": list(self._notes),
        }

    def __repr__(self) -> str:
        """The arm, bodies, pairs, and notes."""
        links = sum(body.is_link for body in self._bodies.values())
        pairs = self.pairs
        counted = sum(pair.counts for pair in pairs)
        notes = "".join(f"\n  {note}" for note in self._notes)
        return (
            f"Scene({self._chain.name!r}, {links} links, {len(self._bodies) - links} other bodies, "
            f"{counted} of {len(pairs)} pairs count){notes}"
        )


def one_q(chain: SerialChain, q: Any) -> Array:
    """Read the joint values of an arm, (n,).

    Raises:
        InvalidProblem: They do not fit it.
    """
    joints = as_joints(chain, q)
    if joints.ndim > 1:
        raise InvalidProblem(f"expected one q of shape ({chain.dof},), got {joints.shape}")
    return joints


def _part(shape: Shape, pose: Any) -> Part:
    if not isinstance(shape, Shape):
        raise InvalidScene(
            f"expected a Box, Sphere, Cylinder, Capsule, Mesh or Points of kinseek.collision, got {type(shape).__name__}"
        )
    if isinstance(shape, Mesh) and shape.hull:
        shape.geometry()  # Says now that there is none.
    return Part(shape, np.eye(4) if pose is None else one_pose(pose, "pose"))
