"""The bodies of a scene in the 3D view, coloured by what the arm hits."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.collision.surfaces import DrawnBody, surface_of
from kinseek.robots.chain import SerialChain
from kinseek.support.transforms import quaternion

from .meshes import MOST_FACES

Array = NDArray[np.float64]

BODY, CARRIED, HIT = (140, 150, 165), (110, 135, 170), (214, 40, 40)

OPACITY = 0.4


@dataclass
class _Drawn:
    """A body with its 3D objects."""

    body: DrawnBody
    frame: Any
    mesh: Any
    """None without triangles."""
    cloud: Any
    """None without points."""
    triangles: int
    whole: bool
    shown: DrawnBody | None = None
    """The body whose place is shown."""

    def paint(self, hit: bool) -> None:
        """Colour it; the shapes of links are visible only while they hit something."""
        colour = HIT if hit else CARRIED if self.body.frame.joints else BODY
        if self.mesh is not None:
            self.mesh.color = colour
        if self.cloud is not None:
            self.cloud.colors = np.array(colour, dtype=np.uint8)
        self.frame.visible = hit or not self.body.is_link


class Bodies:
    """The bodies of one person's scene; `api` is that of their connection alone."""

    def __init__(self, api: Any, pick: Callable[[str], object]) -> None:
        """Begin without bodies; `pick` is called with the name of a body that is clicked and can be moved."""
        self._api, self._pick = api, pick
        self._drawn: dict[str, _Drawn] = {}
        self._hit: Collection[str] = ()
        self._made = 0

    @property
    def boxed(self) -> list[str]:
        """Names of bodies with too many triangles, drawn as the boxes around their meshes."""
        return [name for name, one in self._drawn.items() if not one.whole]

    def take(self, bodies: Iterable[DrawnBody]) -> None:
        """Draw these bodies, and no others; a body that has only moved keeps its 3D objects."""
        known, self._drawn = self._drawn, {}
        for body in bodies:
            one = known.get(body.name)
            if one is not None and _same_shapes(one.body, body):
                del known[body.name]
                one.body = body
                self._drawn[body.name] = one
                continue
            self._drawn[body.name] = self._new(body)
        for one in known.values():
            one.frame.remove()

    def show(self, chain: SerialChain, q: Array, hit: Collection[str]) -> None:
        """Put the bodies where they are at joint values q, (n,), and colour those that the arm hits or that hit it."""
        for name, one in self._drawn.items():
            if one.body.frame.joints or one.shown is not one.body:
                pose = one.body.at(chain, q)
                one.frame.position, one.frame.wxyz = pose[:3, 3], quaternion(pose[:3, :3])
                one.shown = one.body
            if (name in hit) != (name in self._hit):
                one.paint(name in hit)
        self._hit = hit

    def _new(self, body: DrawnBody) -> _Drawn:
        left = MOST_FACES - sum(one.triangles for one in self._drawn.values())
        surface, mesh, cloud = surface_of(body.parts, left), None, None
        self._made += 1  # Names of bodies may have slashes, which viser reads as a tree.
        where = f"/body/{self._made}"
        frame = self._api.add_frame(where, show_axes=False)
        if len(surface.faces):
            mesh = self._api.add_mesh_simple(
                f"{where}/mesh",
                surface.vertices.astype(np.float32),
                surface.faces.astype(np.uint32),
                opacity=OPACITY,
                flat_shading=True,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
            if body.alone:
                self._on_click(mesh, body.name)
        if len(surface.points):
            cloud = self._api.add_point_cloud(
                f"{where}/cloud",
                surface.points.astype(np.float32),
                BODY,
                point_size=surface.size,
                point_shape="circle",
                precision="float32",
            )
        drawn = _Drawn(body, frame, mesh, cloud, len(surface.faces), surface.whole)
        drawn.paint(body.name in self._hit)
        return drawn

    def _on_click(self, mesh: Any, name: str) -> None:
        async def clicked(event: Any) -> None:
            self._pick(name)

        mesh.on_click(clicked)


def _same_shapes(one: DrawnBody, other: DrawnBody) -> bool:
    return one is other or (
        one.alone == other.alone
        and len(one.parts) == len(other.parts)
        and all(
            a.shape == b.shape and bool((a.pose == b.pose).all())
            for a, b in zip(one.parts, other.parts, strict=True)
        )
    )
