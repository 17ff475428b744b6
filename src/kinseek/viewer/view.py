"""The 3D view of one person: the arm, its branches as ghosts, the goal to drag, and clouds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.kernels.arm.forward import forward_many
from kinseek.meshes.parts import import_trimesh
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.transforms import from_quaternion, quaternion, square, transform

from .bodies import HIT, Bodies
from .clouds import Cloud
from .drawing import Figure
from .meshes import Meshes, plain
from .session import POSTURES, Posture, Swept

Array = NDArray[np.float64]

MOST_GHOSTS = 16
"""Maximum number of branches that are drawn; more would hide each other."""

LINK, JOINT = (232, 125, 10), (84, 92, 106)
GHOST = (20, 90, 205)
BLOCKED = (200, 70, 70)
SEARCH = (194, 59, 0)
REACHED, CLOUD = (0, 158, 115), (122, 78, 142)
CURVE, START = (122, 78, 142), (0, 158, 115)

_FAR = 1e-6
"""An invisible size [m]."""


def wxyz_of(turn: Array) -> Array:
    """Convert a rotation matrix, (3, 3), to a quaternion, scalar first."""
    return quaternion(turn)


def matrix_of(wxyz: Array, position: Array) -> Array:
    """Convert a quaternion, scalar first, and a position [m] to a pose, (4, 4)."""
    return transform(from_quaternion(np.asarray(wxyz, dtype=np.float64)), position)


class Poses:
    """Several poses of an arm, drawn from its chain as one node."""

    def __init__(
        self,
        scene: Any,
        name: str,
        figure: Figure,
        count: int,
        colours: tuple[Any, Any],
        opacity: float | None,
    ) -> None:
        """Make space for `count` poses; they are invisible until they are set."""
        trimesh = import_trimesh()
        self._figure, self._count = figure, count
        self._each = figure.links + figure.joints
        rod = trimesh.creation.cylinder(1.0, 1.0, sections=24 if opacity is None else 8)
        rod.apply_translation([0, 0, 0.5])
        places, turns, scales = self._nothing()
        self.node = scene.add_batched_meshes_simple(
            name,
            np.asarray(rod.vertices, dtype=np.float32),
            np.asarray(rod.faces, dtype=np.uint32),
            turns,
            places,
            batched_scales=scales,
            batched_colors=np.tile(
                np.array([colours[0]] * figure.links + [colours[1]] * figure.joints, dtype=np.uint8),
                (count, 1),
            ),
            opacity=opacity,
            lod="off",
            cast_shadow=False,
            receive_shadow=False,
        )

    def _nothing(self) -> tuple[Any, Any, Any]:
        parts = self._count * self._each
        turns = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype=np.float32), (parts, 1))
        return np.zeros((parts, 3), np.float32), turns, np.full((parts, 3), _FAR, np.float32)

    def paint(self, colours: Array) -> None:
        """Give the first poses a colour each, (k, 3)."""
        every = np.zeros((self._count, 3), dtype=np.uint8)
        every[: len(colours)] = colours[: self._count]
        self.node.batched_colors = np.repeat(every, self._each, axis=0)

    def show(self, q: Array, but: int = -1) -> None:
        """Draw these joint values, (k, n), as many as there is space for, except one of them."""
        places, turns, scales = self._nothing()
        q = q[: self._count]
        if len(q):
            drawn, used = self._figure.draw(q), len(q) * self._each
            places[:used] = drawn.start.reshape(-1, 3)
            turns[:used] = drawn.wxyz.reshape(-1, 4)
            scales[:used] = drawn.scale.reshape(-1, 3)
        if but >= 0:
            scales[but * self._each : (but + 1) * self._each] = _FAR
        self.node.batched_positions, self.node.batched_wxyzs, self.node.batched_scales = places, turns, scales

    def which(self, instance: int | None) -> int:
        """Return the index of the pose to which a clicked part belongs."""
        return -1 if instance is None else instance // self._each


class View:
    """One person's view; `api` is that of their connection alone."""

    def __init__(
        self, api: Any, arm: Arm, meshes: Meshes, pick_body: Callable[[str], object] = lambda name: None
    ) -> None:
        """Draw the static parts, and the others in their initial state; `pick_body` gets the name of a clicked body."""
        self._api, self._arm, self._meshes = api, arm, meshes
        self._figure = None if arm.axes is None else Figure(arm.axes)
        self.size = _size(arm) if self._figure is None else self._figure.size
        self._arm_drawn = self._ghosts = self._pass = self._swept = self._start = None
        if self._figure is not None:
            self._arm_drawn = Poses(api, "/arm/links", self._figure, 1, (LINK, JOINT), None)
            self._ghosts = Poses(api, "/ghosts", self._figure, MOST_GHOSTS, (GHOST, GHOST), 0.35)
            self._pass = Poses(api, "/pass", self._figure, 1, (SEARCH, SEARCH), 0.6)
            self._swept = Poses(api, "/swept", self._figure, POSTURES, (CURVE, CURVE), 0.25)
            self._start = Poses(api, "/start", self._figure, 1, (START, START), 0.6)
        self._tip = api.add_frame("/tip", axes_length=0.10 * self.size, axes_radius=0.004 * self.size)
        self.goal = api.add_transform_controls(
            "/goal", scale=0.28 * self.size, line_width=3.0, depth_test=False
        )
        self._miss = api.add_line_segments(
            "/miss",
            np.zeros((1, 2, 3), dtype=np.float32),
            (201, 42, 42),
            thickness=2.5,
            thickness_units="screen",
            visible=False,
        )
        self.bodies = Bodies(api, pick_body)
        self.body = api.add_transform_controls(
            "/chosen", scale=0.2 * self.size, line_width=2.0, depth_test=False, visible=False
        )
        """The gizmo of the body that is edited."""
        self._curve: Any = None
        self._clouds: dict[str, Any] = {}
        self._frames = [api.add_frame(f"/arm/mesh/{i}", show_axes=False) for i in range(len(meshes.links))]
        for i, link in enumerate(meshes.links):
            for k, mesh in enumerate(link.parts):
                _add_mesh(api, f"/arm/mesh/{i}/{k}", mesh)
        api.add_grid(
            "/ground",
            width=3.0 * self.size,
            height=3.0 * self.size,
            cell_size=0.1 * _nice(self.size),
            section_size=0.5 * _nice(self.size),
            cell_color=(160, 160, 160),
            section_color=(130, 130, 130),
            cell_thickness=0.6,
            fade_distance=4.0 * self.size,
            shadow_opacity=0.12,
        )

    def on_ghost(self, pick: Callable[[int], object]) -> None:
        """Call `pick` with the index of a branch whose ghost is clicked."""
        ghosts = self._ghosts
        if ghosts is None:
            return

        async def clicked(event: Any) -> None:
            pick(ghosts.which(event.instance_index))

        ghosts.node.on_click(clicked)

    def show_arm(self, posture: Posture, target: Array, reached: bool) -> None:
        """Move the arm, and show by a line how far its tip is from the goal."""
        q, T = posture.q, posture.tip
        if self._arm.axes is not None:
            self.bodies.show(self._arm.axes, q, {name for one in posture.contacts for name in (one.a, one.b)})
        if self._arm_drawn is not None:
            self._arm_drawn.show(q[None])
        if np.isfinite(T).all():
            self._tip.position, self._tip.wxyz = T[:3, 3], wxyz_of(T[:3, :3])
        for frame, link in zip(self._frames, self._meshes.links, strict=True):
            pose = square(forward_many(link.arrays, q[None])[0, :3])
            frame.position, frame.wxyz = pose[:3, 3], wxyz_of(pose[:3, :3])
        self._miss.visible = bool(not reached and np.isfinite(T).all())
        if self._miss.visible:
            self._miss.points = np.array([[T[:3, 3], target[:3, 3]]], dtype=np.float32)

    def show_goal(self, target: Array) -> None:
        """Move the gizmo to the goal."""
        self.goal.position, self.goal.wxyz = target[:3, 3], wxyz_of(target[:3, :3])

    def show_body(self, pose: Array | None) -> None:
        """Move the gizmo to the body that is edited, at (4, 4), or hide it."""
        self.body.visible = pose is not None
        if pose is not None and not is_at(self.body, pose):
            self.body.position, self.body.wxyz = pose[:3, 3], wxyz_of(pose[:3, :3])

    def show_ghosts(self, q: Array, shown: int, free: NDArray[np.bool_] | None = None) -> None:
        """Draw these solutions, (k, n), transparent, except for the one already shown; red are those that are not free."""
        if self._ghosts is not None:
            self._ghosts.show(q, shown)
            if free is not None:
                self._ghosts.paint(np.where(free[:, None], GHOST, BLOCKED))

    def show_motion(self, swept: Swept | None, start: Array | None) -> None:
        """Draw what a motion passes, red where it hits something, and where it starts, (n,); None: nothing."""
        nothing = np.zeros((0, self._arm.dof))
        if self._swept is not None and self._start is not None:
            self._swept.show(nothing if swept is None else swept.q)
            self._start.show(nothing if start is None else start[None])
        if self._curve is not None:
            self._curve.remove()
            self._curve = None
        if swept is None:
            return
        points = np.stack([swept.places[:-1], swept.places[1:]], axis=1).astype(np.float32)
        free = swept.free[:, None, None]
        colours = np.broadcast_to(np.where(free, CURVE, HIT).astype(np.uint8), points.shape)
        self._curve = self._api.add_line_segments(
            "/motion", points, colours, thickness=2.5, thickness_units="screen"
        )

    def show_pass(self, q: Array | None, places: Array | None) -> None:
        """Show the best joint values after a pass, (n,), and the tip positions at its nodes, (k, 3); None: nothing."""
        if self._pass is not None:
            self._pass.show(np.zeros((0, self._arm.dof)) if q is None else q[None])
        self.show_cloud(
            "visited", None if places is None else Cloud(places, np.zeros(len(places))), SEARCH, 0.006
        )

    def show_cloud(self, name: str, cloud: Cloud | None, colour: Sequence[int], point: float = 0.006) -> None:
        """Show points, pale where their shade is 1, or nothing; `point` is their size relative to the arm's."""
        known = self._clouds.pop(name, None)
        if known is not None:
            known.remove()
        if cloud is None or not len(cloud.points):
            return
        colours = np.array(colour) + (np.array([205, 205, 205]) - np.array(colour)) * cloud.shade[:, None]
        self._clouds[name] = self._api.add_point_cloud(
            f"/cloud/{name}",
            np.asarray(cloud.points, dtype=np.float32),
            colours.astype(np.uint8),
            point_size=point * self.size,
            point_shape="circle",
            point_shading="flat",
            precision="float32",
        )

    def see(self, ghosts: bool, meshes: bool, swept: bool = True) -> None:
        """Show or hide the ghosts and the postures along a motion; draw the arm by its meshes or by its links."""
        if self._ghosts is not None and self._swept is not None:
            self._ghosts.node.visible, self._swept.node.visible = ghosts, swept
        solid = meshes and bool(self._frames)
        for frame in self._frames:
            frame.visible = solid
        if self._arm_drawn is not None:
            self._arm_drawn.node.visible = not solid

    def limit_gizmo(self, turns: bool) -> None:
        """Hide the rings for rotation if no orientation is constrained."""
        self.goal.disable_rotations = not turns


def is_at(gizmo: Any, pose: Array) -> bool:
    """Return whether a gizmo is at a pose, (4, 4), already, as when it is dragged there."""
    return bool(np.abs(pose - matrix_of(gizmo.wxyz, gizmo.position)).max() <= 1e-9)


def _size(arm: Arm) -> float:
    """Return the approximate reach of an arm with black-box kinematics [m]."""
    places = arm.fk(arm.sample(200))[:, :3, 3]
    places = places[np.isfinite(places).all(axis=1)]
    return max(float(np.linalg.norm(places, axis=1).max()), 1e-3)


def _nice(size: float) -> float:
    """Return a power of ten near a size."""
    return float(10.0 ** np.round(np.log10(size)))


def _add_mesh(api: Any, name: str, mesh: Any) -> None:
    """Draw a mesh, without its look if that cannot be written."""
    try:
        api.add_mesh_trimesh(name, mesh)
    except Exception as error:  # An image is cut off, for example: it is decoded now.
        raise_of_handler(error)
        api.add_mesh_trimesh(name, plain(mesh))
