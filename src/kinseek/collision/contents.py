"""The contents of a scene: links of an arm, obstacles, attached objects, and the pairs of these that are checked."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidProblem, InvalidScene, suggest
from kinseek.kernels.arm.pose_error import LARGEST
from kinseek.poses import one_pose
from kinseek.printable import printable
from kinseek.problem import as_joints
from kinseek.robots.chain import Frame, SerialChain
from kinseek.support.units import warn_of_distance
from kinseek.support.validation import as_flag

from .assembly import Assembly, assemble, sampled
from .bodies import ArmBodies, Body, Part, package_folders, require_number
from .clouds import Cloud, Points, Voxels
from .margins import Margins
from .obstacles import obstacles
from .others import OtherArm
from .pairs import ALWAYS, ATTACHED, MAY_TOUCH, NOTHING_CHECKED, Pair, key, pairs_of
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere, file_path, length_or_zero

Array = NDArray[np.float64]


class Contents:
    """The bodies of a scene, by name, and the pairs of them that are never checked; `Scene` has the queries."""

    def __init__(
        self, chain: SerialChain, arm: ArmBodies, never: dict[tuple[str, str], str], samples: int
    ) -> None:
        """Assemble the data that `Scene.of` has read."""
        self._samples = samples
        self._chain, self._links = chain, arm.links
        self._bodies = dict[str, Body]()
        self._require_room(arm.bodies)
        self._bodies |= {body.name: body for body in arm.bodies}
        self._never = never
        self._notes = list(arm.notes)
        self._others: dict[str, OtherArm] = {}
        self._state = object()
        """Another object after every change of the contents."""
        self._assembled: tuple[object, Assembly] | None = None
        """The state that was assembled last, and its engine."""
        self._margins: Margins | None = None

    def add_box(self, name: str, size: ArrayLike, pose: Any = None) -> None:
        """Add a box.

        Args:
            name: Name of the new body.
            size: Edge lengths along its x, y and z axes [m].
            pose: Pose of its centre in the base of the arm, (4, 4), or an object that carries one; by default the base
                itself.

        Raises:
            InvalidScene: The name is taken, or the size is invalid.
            InvalidGoal: `pose` is invalid.
        """
        self._add(name, Box(size), pose)

    def add_sphere(self, name: str, radius: float, pose: Any = None) -> None:
        """Add a sphere with a radius [m]; see `add_box`."""
        self._add(name, Sphere(radius), pose)

    def add_cylinder(self, name: str, radius: float, length: float, pose: Any = None) -> None:
        """Add a cylinder about the z axis of its pose, lengths in [m]; see `add_box`."""
        self._add(name, Cylinder(radius, length), pose)

    def add_capsule(self, name: str, radius: float, length: float, pose: Any = None) -> None:
        """Add a cylinder with round ends about the z axis of its pose; `length` [m] excludes the ends; see `add_box`."""
        self._add(name, Capsule(radius, length), pose)

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
        """Add a triangle mesh from a file.

        A closed surface of the mesh is solid, whichever way its triangles are oriented; one wholly inside another and
        oriented the other way is a cavity. An open surface is thin: a body wholly behind it does not touch it, and `notes`
        reports this.

        Args:
            name: Name of the new body.
            path: An STL, OBJ, PLY, GLB or DAE (COLLADA) file.
            pose: See `add_box`.
            scale: One factor, or one along each axis.
            hull: Use its convex hull, which is faster to check and always solid.
            simplify: Simplify to fewer triangles, moving no point farther than this [m]. The body is made thicker by the
                same distance, so that free of it implies free of the mesh; `notes` reports how much. By default nothing is
                simplified.

        Raises:
            InvalidScene: As `add_box`, or the file is missing, empty or cannot be read, or it has more than a million
                triangles without `hull` or `simplify`.
        """
        mesh = Mesh.read(path, scale, hull, simplify)
        count, thicker = len(mesh.faces), mesh.thicker
        simplified = (
            f"{name!r} is simplified to {count:,} triangles, and is treated as {thicker:.2g} m thicker"
        )
        self._add(name, mesh, pose, notes=[] if simplify is None else [simplified])

    def add_points(
        self,
        name: str,
        cloud: ArrayLike,
        radius: float,
        pose: Any = None,
        *,
        simplify: float | None = None,
        replace: bool = False,
    ) -> None:
        """Add a point cloud, as from a depth camera; each point is a ball.

        Nothing is known of what lies between and behind these balls: choose a radius of at least the distance of neighbours.

        Args:
            name: Name of the new body.
            cloud: Points, (k, 3) [m].
            radius: Radius of each ball [m].
            pose: Pose of the frame of the points, such as that of the camera; see `add_box`.
            simplify: Merge points such that none moves farther than this [m]. The radius is then enlarged by the largest
                such motion, so that free of it implies free of the original balls; `notes` reports how much. By default
                nothing is simplified.
            replace: Replace the points of this name if there are some, as in `add`.

        Raises:
            InvalidScene: As `add`; no points, more than a million without `simplify`, or NaN, of which the message gives the
                number of points; or an invalid length.
        """
        if simplify is None:
            self._add(name, Points(cloud, radius), pose, replace)
            return
        points = Points.merged(cloud, radius, simplify)
        count, thicker = len(points.places), points.radius - radius
        simplified = f"{name!r} is simplified to {count:,} points, and is treated as {thicker:.2g} m thicker"
        self._add(name, points, pose, replace, [simplified])

    def add_voxels(
        self, name: str, occupied: ArrayLike, size: float, pose: Any = None, *, replace: bool = False
    ) -> None:
        """Add the occupied cells of a grid, such as an occupancy map; each cell is a solid cube.

        Args:
            name: Name of the new body.
            occupied: Which cells are occupied, (i, j, k) bool, along x, y and z.
            size: Edge length of a cell [m].
            pose: Pose of the corner of the grid at its first cell, in the base of the arm, (4, 4), or an object that carries
                one; by default the base itself.
            replace: Replace the cells of this name if there are some, as in `add`.

        Raises:
            InvalidScene: As `add`; not Boolean values in three dimensions, no occupied cell or more than a million; or
                an invalid size.
        """
        self._add(name, Voxels(occupied, size), pose, replace)

    def add(self, name: str, shape: Shape, pose: Any = None, *, replace: bool = False) -> None:
        """Add a shape of `kinseek.collision`.

        Args:
            name: Name of the new body.
            shape: The shape.
            pose: Pose of the shape in the base of the arm; see `add_box`.
            replace: Replace the body of this name if there is one, also one that is attached; what `allow` says of it
                remains. A link or another arm is not replaced. If an error is raised, the old body stays.

        Raises:
            InvalidScene: The name is taken, or `shape` is not a shape.
            InvalidGoal: `pose` is invalid.

        Warns:
            UnitWarning: It is a new body, more than ten times as far from the base as the arm reaches.
        """
        self._add(name, shape, pose, replace)

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
        """Add all objects of a file; meshes are treated as in `add_mesh`.

        Args:
            path: A ``.urdf`` or ``.xacro`` file whose joints are all fixed: its links with collision elements, by their
                names. Or a MoveIt ``.scene`` file: its objects by their names, which are boxes, spheres, cylinders and
                meshes.
            pose: Pose of the root link, or of MoveIt's planning frame, in the base of the arm, (4, 4), or an object that
                carries one; by default the base itself.
            prefix: Prefix of all names, for a file that is added twice.
            meshes: Folders of packages, or ``"skip"``, as in `Scene.of`; the folders known for the arm are searched, too.
            missing: How to treat a mesh that cannot be read, as in `Scene.of`.
            trusted: May Python evaluate the expressions of a xacro file?

        Returns:
            Names of the new bodies. Either all are added, or none.

        Raises:
            InvalidScene: The file cannot be read, or it has a movable joint, an unknown shape or no shapes; a mesh is
                missing, empty or broken; or a name is taken.
            InvalidGoal: `pose` is invalid.
            MissingExtra: trimesh is not installed.

        Warns:
            UnitWarning: A body of the file is more than ten times as far from the base as the arm reaches.
        """
        trusted = as_flag("trusted", trusted, InvalidScene)
        meshes, skip = read_missing(meshes, missing)
        folders = {name: Path(folder) for name, folder in self._chain.packages.items()}
        folders |= package_folders(meshes)
        found, notes = obstacles(file_path(path), folders, skip, trusted)
        base = np.eye(4) if pose is None else one_pose(pose, "pose")
        # As in `add_arm`, nothing is added before everything is checked.
        self._require_room(found)
        try:
            names = tuple(self._new(f"{prefix}{body.name}") for body in found)
        except InvalidScene as error:
            raise InvalidScene(
                f'{path}: {error}; prefix= adds a prefix to the names of a file: prefix="left "'
            ) from None
        placed = [
            replace(body, name=name, frame=Frame(0, base @ body.frame.pose))
            for name, body in zip(names, found, strict=True)
        ]
        draft = copy(self)
        for body in placed:
            draft._enter(body)
        draft._notes.extend(notes)
        self._warn_if_far(placed, f"{path}: ")  # It may be made an error.
        self._become(draft)
        return names

    def attach(
        self,
        name: str,
        shape: Shape,
        to: str,
        pose: Any = None,
        touches: Iterable[str] = (),
        padding: float = 0.0,
        *,
        replace: bool = False,
    ) -> None:
        """Attach a shape to a link: a tool, or an object in a gripper. It moves with the link, and is checked like a link.

        Pairs that touch at every one of the scene's random joint values are not checked, as for links; `pairs` lists them.

        Args:
            name: Name of the new body.
            shape: A `Box`, `Sphere`, `Cylinder`, `Capsule` or hull of a `Mesh` from `kinseek.collision`.
            to: A link of the file, with or without geometry.
            pose: Pose of the shape in the frame of that link, (4, 4), or an object that carries one; by default that frame.
            touches: Names of bodies that it may touch, in addition to that link.
            padding: Added to it on every side [m].
            replace: Replace the body of this name if there is one, as in `add`; the hand takes an object, for example.

        Raises:
            InvalidScene: The name is taken, the link or a body is unknown, or the shape cannot be attached.
            InvalidGoal: `pose` is invalid.

        Warns:
            UnitWarning: It is a new body, and extends farther than ten times the arm's reach.
        """
        self._require(to, self._links, "link")
        if isinstance(shape, Cloud) or (isinstance(shape, Mesh) and not shape.hull):
            raise InvalidScene(
                "an attached body must be convex: a cloud or grid cannot be attached, a mesh only as its hull, hull=True"
            )
        if isinstance(touches, str) or not isinstance(touches, Iterable):
            raise InvalidScene(f"touches must be names of bodies, got {touches!r:.80}")
        touches = list(touches)
        for other in touches:
            self._require(other, self._bodies)
        part = _part(shape, pose)
        frame = self._links[to]
        thicker = length_or_zero("padding", padding)
        body = Body(self._new(name, replace), frame, [part], is_attached=True, padding=thicker)
        draft = copy(self)
        draft._enter(body)
        for other in {to, *touches} & self._bodies.keys():
            draft._never[key(name, other)] = ATTACHED if other == to else MAY_TOUCH
        draft._sample(self._samples, False, name)
        if name not in self._bodies:
            self._warn_if_far([body])
        self._become(draft)

    def add_arm(self, name: str, other: Contents, q: Any, pose: Any = None) -> None:
        """Add another arm as an obstacle at fixed joint values; `move` changes them.

        Its links and the objects attached to them are taken from its own scene in their current state, with their padding;
        the obstacles around it are not. Their names here are ``name/link``. Self-collision of the other arm is not checked,
        nor whether it hits what no joint of this arm moves, such as this arm's base link and its obstacles: ask the scene of
        the other arm, with this arm in it.

        Args:
            name: Name of the other arm in this scene.
            other: The scene of the other arm; it may be of the same model.
            q: Joint values of the other arm, (m,), [rad] or [m], or by name.
            pose: Pose of the base of the other arm in the base of this one, (4, 4), or an object that carries one; by
                default the same base.

        Raises:
            InvalidScene: The name is taken, or `other` is not a scene.
            InvalidProblem: `q` does not fit the other arm.
            InvalidGoal: `pose` is invalid.
        """
        if not isinstance(other, Contents):
            raise InvalidScene(
                f"expected the kinseek.Scene of the other arm, got {type(other).__name__}; make one: Scene.of(other_arm)"
            )
        base = np.eye(4) if pose is None else one_pose(pose, "pose")
        own = [body for body in other._all() if body.of_arm]
        arm = OtherArm(self._new(name), other._chain, base, own)
        added = arm.at(other._one(q))
        # Everything is checked before anything is added, so an error leaves the scene as it was.
        self._require_room(added)
        for body in added:
            self._new(body.name)
        self._publish(
            _bodies=self._bodies | {body.name: body for body in added}, _others=self._others | {name: arm}
        )

    def move(self, name: str, q: Any) -> None:
        """Move another arm of the scene to other joint values, without rebuilding the engine.

        Args:
            name: Its name in `add_arm`.
            q: Its joint values, (m,), [rad] or [m], or by name.

        Raises:
            InvalidScene: No such arm.
            InvalidProblem: `q` does not fit it.
        """
        self._require(name, self._others, "arm of the scene")
        arm = self._others[name]
        self._stand(arm.at(one_q(arm.chain, q)))

    def allow(self, a: str, b: str, reason: str = "allowed: they may touch") -> None:
        """Exclude a pair of bodies from the checks.

        Raises:
            InvalidScene: An unknown body.
        """
        self._require(a, self._bodies)
        self._require(b, self._bodies)
        self._publish(_never=self._never | {key(a, b): str(reason) or "allowed: they may touch"})

    def remove(self, name: str) -> None:
        """Remove a body that was added or attached, or another arm.

        Raises:
            InvalidScene: It does not exist, or it is a link of an arm.
        """
        self._require(name, {**self._bodies, **self._others})
        if name in self._others:
            self._publish(**self._without(self._others[name].names), _others=_left(self._others, {name}))
            return
        if owner := next((arm.name for arm in self._others.values() if name in arm.names), None):
            raise InvalidScene(
                f"{name!r} belongs to the arm {owner!r}; remove({owner!r}) removes the whole arm"
            )
        if self._bodies[name].is_link:
            raise InvalidScene(
                f"{name!r} is a link of the arm; allow({name!r}, other) lets it touch another body"
            )
        self._publish(**self._without([name]))

    @property
    def arm(self) -> str:
        """Name and joints of the arm, for messages."""
        return f"{self._chain.name!r} with joints {', '.join(self._chain.joint_names)}"

    @property
    def state(self) -> object:
        """Another object after every change of the bodies or of the pairs that are checked."""
        return self._state

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of all bodies: links of the arm with geometry, then added bodies."""
        return tuple(self._bodies)

    @property
    def pairs(self) -> tuple[Pair, ...]:
        """All pairs of bodies: those that are checked, and the others with the reason; each prints as a line."""
        return tuple(pairs_of(*self._now()))

    @property
    def notes(self) -> tuple[str, ...]:
        """One sentence each on what was left out, what was replaced, and the values of joints that are not the arm's."""
        return (*self._notes, *([] if self.checks else [NOTHING_CHECKED]))

    @property
    def checks(self) -> bool:
        """Is at least one pair of bodies checked? Otherwise everything is free."""
        return any(pair.counts for pair in pairs_of(*self._now()))

    @property
    def _made(self) -> Assembly:
        """The engine of the current contents, and the body of each part."""
        state, assembled = self._state, self._assembled
        if assembled is None or assembled[0] is not state:
            # If another thread changes the contents meanwhile, the next call assembles them again.
            bodies, never = self._now()
            self._assembled = assembled = state, assemble(self._chain, bodies, pairs_of(bodies, never))
        return assembled[1]

    def _publish(self, **contents: Any) -> None:
        """Take over changed contents, attributes of this object.

        This is one step: no other thread sees half of the changes, and Ctrl-C leaves none. What was published is never
        changed in place.
        """
        vars(self).update(contents, _state=object())

    def _become(self, draft: Contents) -> None:
        """Take over the contents of a changed copy.

        Raises:
            InvalidScene: Another thread has changed the contents since they were copied.
        """
        if draft._state is not self._state:
            raise InvalidScene(
                "another thread changed the scene at the same time; let only one thread change it"
            )
        self._publish(_bodies=draft._bodies, _never=draft._never, _notes=draft._notes)

    def _without(self, names: Sequence[str]) -> dict[str, Any]:
        """Return the contents without some bodies, as `_publish` takes them."""
        gone = set(names)
        return {
            "_bodies": _left(self._bodies, gone),
            "_never": {pair: why for pair, why in self._never.items() if gone.isdisjoint(pair)},
            "_notes": _forgotten(self._notes, names),
        }

    def _now(self) -> tuple[list[Body], dict[tuple[str, str], str]]:
        """Return the bodies and the pairs that are never checked, both of this moment: another thread may change them.

        A body with the pairs of the one that replaces it could touch another body unnoticed.
        """
        now = dict(vars(self))
        return list(now["_bodies"].values()), now["_never"]

    def _all(self) -> list[Body]:
        """Return the bodies of this moment, which another thread may change."""
        return list(self._bodies.values())

    def _sample(self, samples: int, skip_never: bool, name: str | None = None) -> None:
        """Find the pairs carried by the arm that touch at all samples, or at none; if `name` is given, only its pairs."""
        carried = {body.name for body in self._all() if body.of_arm}
        open_pairs = [pair for pair in self.pairs if pair.counts and {pair.a, pair.b} <= carried]
        open_pairs = [pair for pair in open_pairs if name in (None, pair.a, pair.b)]
        self._never |= sampled(self._chain, self._all(), open_pairs, samples, skip_never)

    @property
    def _standing(self) -> list[Body]:
        """The bodies that no joint of the arm moves, other than its links."""
        return [body for body in self._all() if not body.of_arm]

    def _stand(self, moved: Sequence[Body]) -> None:
        """Replace bodies that no joint moves by the same ones at other places."""
        _require_near(moved)
        before, assembled = self._state, self._assembled
        self._publish(_bodies=self._bodies | {body.name: body for body in moved})
        # The shapes stay the same, so only their places change in an engine that exists already.
        if assembled is not None and assembled[0] is before:
            after = self._state
            assembled[1].stand(moved)
            self._assembled = after, assembled[1]

    def _of(self, chain: SerialChain) -> Self:
        """Return a copy for the same arm with other limits and another tool."""
        other = copy(self)
        other._chain = chain
        return other

    def _place(self, name: str, pose: Any) -> None:
        """Move a body that stands by itself, such that its first shape is at a pose, (4, 4)."""
        body = self._bodies[name]
        first = one_pose(pose, "pose") @ np.linalg.inv(body.parts[0].pose)
        self._stand([replace(body, frame=Frame(0, first))])

    def _one(self, q: Any) -> Array:
        return one_q(self._chain, q)

    def _add(
        self, name: str, shape: Shape, pose: Any, replace: bool = False, notes: Sequence[str] = ()
    ) -> None:
        """Add a shape; see `add`. The caller is a method that the user calls: a warning blames the line that calls it."""
        part, draft = _part(shape, pose), copy(self)
        body = Body(draft._new(name, replace), Frame(0, np.eye(4)), [part])
        if name not in draft._bodies:  # A program that replaces a body many times is told once.
            self._warn_if_far([body], level=4)
        draft._enter(body)
        draft._notes.extend(notes)
        self._become(draft)

    def _warn_if_far(self, bodies: Sequence[Body], where: str = "", level: int = 3) -> None:
        """Warn of the farthest of new bodies, if it is far beyond the arm's reach: its lengths may be in millimetres.

        What the arm carries may not even extend that far.
        """
        found = []
        for body in bodies:
            nearest, farthest = _distances(body)
            found.append((farthest if body.of_arm else nearest, body))
        distance, body = max(found, key=lambda one: one[0])
        what = f"{where}{body.name!r} {'extends' if body.of_arm else 'is'}"
        origin = "the joint that carries it" if body.frame.joints else "the base"
        warn_of_distance(distance, self._chain.reach, level, what, origin)

    def _new(self, name: str, replace: bool = False) -> str:
        if not isinstance(name, str) or not name:
            raise InvalidScene(f"a body needs a name, got {name!r:.200}")
        others = {body for arm in self._others.values() for body in arm.names}
        if (
            as_flag("replace", replace, InvalidScene)
            and name in self._bodies.keys() - self._links.keys() - others
        ):
            return name
        if name in self._bodies or name in self._links or name in self._others:
            if name in self._links:
                raise InvalidScene(f"{name!r} is a link of the arm already; names are unique")
            what = "an arm" if name in self._others else "a body"
            raise InvalidScene(
                f"{name!r} is {what} of the scene already; names are unique. remove({name!r}) removes it"
            )
        return name

    def _require_room(self, bodies: Sequence[Body]) -> None:
        _require_near(bodies)
        all_bodies = self._bodies | {body.name: body for body in bodies}
        require_number(sum(len(body.parts) for body in all_bodies.values()))

    def _require(self, name: str, among: Collection[str], noun: str = "body") -> None:
        if not isinstance(name, str) or name not in among:
            raise InvalidScene(suggest(str(name), among, noun))

    def _enter(self, body: Body) -> None:
        """Add a body to this draft."""
        self._require_room([body])
        # What follows from a replaced body's being attached does not hold for the new one.
        mine = (ATTACHED, MAY_TOUCH, ALWAYS)
        self._never = {
            pair: why for pair, why in self._never.items() if not (body.name in pair and why.startswith(mine))
        }
        self._notes = _forgotten(self._notes, [body.name])
        self._bodies[body.name] = body
        shapes = [part.shape for part in body.parts]
        opened = [
            shape for shape in shapes if isinstance(shape, Mesh) and not shape.hull and not shape.closed
        ]
        if any(shape.interior.any_solid for shape in opened):
            self._notes.append(
                f"{body.name!r} is an open mesh in part: what lies wholly behind its open surfaces does not touch them"
            )
        elif opened:
            self._notes.append(
                f"{body.name!r} is an open mesh, a surface: what lies wholly behind it does not touch it"
            )

    def __getstate__(self) -> dict[str, Any]:
        """Pickle and copy the contents; the engine and the bounds of distances are rebuilt."""
        # In one step, as `_now`; the copy may be changed in place.
        state = dict(vars(self))
        own = {name: copy(state[name]) for name in ("_bodies", "_others", "_never", "_notes")}
        return state | own | {"_assembled": None, "_margins": None}

    def __repr__(self) -> str:
        """The arm, bodies, pairs, and notes."""
        notes = "".join(f"\n  {printable(note)}" for note in self._notes)
        bodies, never = self._now()
        pairs = list(pairs_of(bodies, never))
        links, counted = sum(body.is_link for body in bodies), sum(pair.counts for pair in pairs)
        return (
            f"Scene({self._chain.name!r}, {links} links, {len(bodies) - links} other bodies, "
            f"{counted} of {len(pairs)} pairs checked){notes}"
        )


def read_missing(meshes: Any, missing: str) -> tuple[Any, bool]:
    """Return folders of packages, and whether unreadable meshes are left out.

    Raises:
        InvalidScene: `missing` is neither ``"error"`` nor ``"skip"``.
    """
    if missing not in ("error", "skip"):
        raise InvalidScene(suggest(str(missing), ("error", "skip"), "value of missing"))
    alone = isinstance(meshes, str) and meshes == "skip"
    return () if alone else meshes, alone or missing == "skip"


def one_q(chain: SerialChain, q: Any) -> Array:
    """Read the joint values of an arm, (n,).

    Raises:
        InvalidProblem: They do not fit the arm.
    """
    joints = as_joints(chain, q)
    if joints.ndim > 1:
        raise InvalidProblem(f"expected one q of shape ({chain.dof},), got {joints.shape}")
    return joints


def _require_near(bodies: Iterable[Body]) -> None:
    """Reject bodies that stand too far from the base of the arm to compute with.

    Raises:
        InvalidScene: There is one.
    """
    for body in bodies:
        for part in body.parts:
            with np.errstate(over="ignore", invalid="ignore"):
                farthest = float(np.abs(body.frame.pose @ part.pose).max())
            if not farthest <= LARGEST:  # It may be NaN.
                raise InvalidScene(
                    f"{body.name!r}: a shape must stand within {LARGEST:g} m of the origin along each axis, got "
                    f"{farthest:g} m"
                )


def _distances(body: Body) -> tuple[float, float]:
    """Bound the distances of a body's nearest and farthest point from its joint, or from the base [m]."""
    nearest, farthest = np.inf, 0.0
    for part in body.parts:
        place, thick = body.frame.pose @ part.pose, part.shape.thickness + body.padding
        corners = part.shape.corners @ place[:3, :3].T + place[:3, 3]
        beyond = np.maximum(np.maximum(corners.min(axis=0), -corners.max(axis=0)), 0.0)
        nearest = min(nearest, float(np.linalg.norm(beyond)) - thick)
        farthest = max(farthest, float(np.linalg.norm(corners, axis=1).max()) + thick)
    return nearest, farthest


def _part(shape: Shape, pose: Any) -> Part:
    if not isinstance(shape, Shape):
        raise InvalidScene(
            "expected a Box, Sphere, Cylinder, Capsule, Mesh, Points or Voxels of kinseek.collision, got "
            f"{type(shape).__name__}"
        )
    if isinstance(shape, Mesh) and shape.hull:
        shape.geometry()  # Raises an error now if there is none.
    return Part(shape, np.eye(4) if pose is None else one_pose(pose, "pose"))


def _left(known: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """Return the items of other names."""
    return {name: each for name, each in known.items() if name not in names}


def _forgotten(notes: Sequence[str], names: Sequence[str]) -> list[str]:
    """Return the notes without those about some bodies, which begin with the quoted name."""
    return [note for note in notes if not note.startswith(tuple(f"{name!r} " for name in names))]
