"""What is in a scene: the links of an arm, what stands around it and what it carries, and which pairs of these count."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem, InvalidScene, suggest
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.poses import one_pose
from kinseek.printable import printable
from kinseek.problem import as_joints
from kinseek.robots.chain import Frame, SerialChain

from .assembly import Assembly, assemble, sampled
from .bodies import ArmBodies, Body, Part, package_folders, require_number
from .obstacles import obstacles
from .others import OtherArm
from .pairs import ATTACHED, Pair, key, pairs_of
from .shapes import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere, length_or_zero

Array = NDArray[np.float64]


class Contents:
    """The bodies of a scene, by name, and the pairs of them that never count; what it answers stands in `Scene`."""

    def __init__(
        self, chain: SerialChain, arm: ArmBodies, never: dict[tuple[str, str], str], samples: int
    ) -> None:
        """Put together what `Scene.of` has read."""
        self._samples = samples
        self._chain, self._links = chain, arm.links
        self._bodies = dict[str, Body]()
        self._require_room(arm.bodies)
        self._bodies |= {body.name: body for body in arm.bodies}
        self._never = never
        self._notes = list(arm.notes)
        self._others: dict[str, OtherArm] = {}
        self._assembly: Assembly | None = None

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
            path: An STL, OBJ, PLY, GLB or DAE (COLLADA) file.
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

    def add_file(
        self,
        path: str | Path,
        pose: Any = None,
        *,
        prefix: str = "",
        meshes: Iterable[str | Path] | Mapping[str, str | Path] | Literal["skip"] = (),
        missing: Literal["error", "skip"] = "error",
        trusted: bool = True,
    ) -> tuple[str, ...]:
        """Add all that stands in a file: its meshes count as those of `add_mesh` do.

        Args:
            path: A ``.urdf`` or ``.xacro`` file whose joints are all fixed: its links with collision elements, by their
                names. Or a ``.scene`` file as MoveIt writes it: its objects by theirs, boxes, spheres, cylinders and meshes.
            pose: Of the root link, or of MoveIt's planning frame, in the base of the arm, (4, 4), or an object that carries
                one; the base itself unless given.
            prefix: Put before every name, where a file is added twice.
            meshes: Folders of packages, or ``"skip"``, as in `Scene.of`; those known of the arm are looked at, too.
            missing: What to do about a mesh that cannot be read, as in `Scene.of`.
            trusted: May Python evaluate the expressions of a xacro file?

        Returns:
            Names of the new bodies. All are added, or none.

        Raises:
            InvalidScene: The file cannot be read, holds a joint that moves, a shape that is not known or none at all; a mesh
                that is missing, empty or broken; a name that is taken.
            InvalidGoal: `pose` is none.
            MissingExtra: trimesh is not installed.
        """
        meshes, skip = read_missing(meshes, missing)
        folders = {name: Path(folder) for name, folder in self._chain.packages.items()}
        folders |= package_folders(meshes)
        found, notes = obstacles(Path(path).expanduser(), folders, skip, trusted)
        base = np.eye(4) if pose is None else one_pose(pose, "pose")
        self._require_room(found)
        try:
            names = tuple(self._new(f"{prefix}{body.name}") for body in found)
        except InvalidScene as error:
            raise InvalidScene(
                f'{path}: {error}; prefix= puts something before the names of a file: prefix="left "'
            ) from None
        for name, body in zip(names, found, strict=True):
            self._enter(replace(body, name=name, frame=Frame(0, base @ body.frame.pose)))
        self._notes.extend(notes)
        return names

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

    def add_arm(self, name: str, other: Contents, q: Any, pose: Any = None) -> None:
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
        if not isinstance(other, Contents):
            raise InvalidScene(
                f"expected the kinseek.Scene of the other arm, got {type(other).__name__}; make one: Scene.of(other_arm)"
            )
        base = np.eye(4) if pose is None else one_pose(pose, "pose")
        own = [body for body in other._bodies.values() if body.is_link or body.frame.joints]
        arm = OtherArm(self._new(name), other._chain, base, own)
        added = arm.at(other._one(q))
        self._require_room(added)
        for body in added:
            self._new(body.name)
        self._bodies |= {body.name: body for body in added}
        self._others[name], self._assembly = arm, None

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
        if self._assembly is not None:
            self._assembly.stand(moved)

    def allow(self, a: str, b: str, reason: str = "said: they may touch") -> None:
        """Leave a pair of bodies out of what counts.

        Raises:
            InvalidScene: An unknown body.
        """
        self._require(a)
        self._require(b)
        self._never[key(a, b)] = str(reason) or "said: they may touch"
        self._assembly = None

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
        self._assembly = None

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

    @property
    def _made(self) -> Assembly:
        """The engine of what is in the scene now, and whose its parts are."""
        if self._assembly is None:
            self._assembly = assemble(self._chain, self._bodies.values(), self.pairs)
        return self._assembly

    def _sample(self, samples: int, skip_never: bool, name: str | None = None) -> None:
        """Find pairs of what the arm carries that touch at all samples, or at none; of those of one body if it is named."""
        carried = {body.name for body in self._bodies.values() if body.is_link or body.frame.joints}
        open_pairs = [pair for pair in self.pairs if pair.counts and {pair.a, pair.b} <= carried]
        open_pairs = [pair for pair in open_pairs if name in (None, pair.a, pair.b)]
        self._never |= sampled(self._chain, self._bodies.values(), open_pairs, samples, skip_never)
        self._assembly = None

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

    def _require_room(self, bodies: Sequence[Body]) -> None:
        for body in bodies:
            for part in body.parts:
                with np.errstate(over="ignore", invalid="ignore"):
                    farthest = float(np.abs(body.frame.pose @ part.pose).max())
                if not farthest <= LARGEST:  # It may be NaN.
                    raise InvalidScene(
                        f"{body.name!r}: a shape must stand within {LARGEST:g} m of the origin along each axis, got "
                        f"{farthest:g} m"
                    )
        require_number(sum(len(body.parts) for body in (*self._bodies.values(), *bodies)))

    def _require(self, name: str) -> None:
        if name not in self._bodies:
            raise InvalidScene(suggest(str(name), self._bodies, "body"))

    def _enter(self, body: Body) -> None:
        self._require_room([body])
        self._bodies[body.name] = body
        self._assembly = None
        shapes = [part.shape for part in body.parts]
        if any(isinstance(shape, Mesh) and not shape.hull and not shape.closed for shape in shapes):
            self._notes.append(
                f"{body.name!r} is an open mesh, a surface: what lies wholly behind it does not touch it"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Pickle and copy what it is made of; the engine is made anew."""
        state = {**self.__dict__, "_assembly": None}
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
        notes = "".join(f"\n  {printable(note)}" for note in self._notes)
        return (
            f"Scene({self._chain.name!r}, {links} links, {len(self._bodies) - links} other bodies, "
            f"{counted} of {len(pairs)} pairs count){notes}"
        )


def read_missing(meshes: Any, missing: str) -> tuple[Any, bool]:
    """Folders of packages, and whether meshes are left out that cannot be read.

    Raises:
        InvalidScene: `missing` is neither word for it.
    """
    if missing not in ("error", "skip"):
        raise InvalidScene(suggest(str(missing), ("error", "skip"), "value of missing"))
    alone = isinstance(meshes, str) and meshes == "skip"
    return () if alone else meshes, alone or missing == "skip"


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
