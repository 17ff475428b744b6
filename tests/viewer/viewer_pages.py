"""Pages of the viewer without a browser, and waiting for them."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any
from unittest.mock import MagicMock, patch

import numpy as np

import kinseek
from kinseek import Arm
from kinseek.viewer.meshes import Meshes
from kinseek.viewer.options import ViewerOptions
from kinseek.viewer.session import Session

KINDS = ("planar2", "cylindrical3", "scara4", "so101", "ur5e", "panda", "ur10e_rail", "atlas_torso_arm")
"""2 to 10 joints, slides and mimics among them."""

CAMERA: dict[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": [1.0, 0.0, 0.0, 0.0],
    "position": [1.0, 1, 1],
    "fov": 0.8,
    "near": 0.01,
    "far": 100,
    "image_height": 600,
    "image_width": 800,
    "look_at": [0.0, 0.0, 0.0],
    "up_direction": [0.0, 0.0, 1.0],
}
"""The message after which a client has a page."""


def wait_until(there: Callable[[], object], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.005)


def client() -> Any:
    """Stands for a browser; every 3D object and every input is one of its own."""
    made = MagicMock(client_id=1)
    made.camera.aspect = 1.5
    for name in ("add_html", "add_slider", "add_checkbox", "add_vector3", "add_dropdown", "add_button_group"):
        getattr(made.gui, name).side_effect = lambda *given, **named: MagicMock(value=False)
    for name in ("add_frame", "add_mesh_simple", "add_point_cloud", "add_line_segments"):
        getattr(made.scene, name).side_effect = lambda *given, **named: MagicMock()
    return made


@contextmanager
def page_of(session: Session, motion: kinseek.Trajectory | None = None, browser: Any = None) -> Iterator[Any]:
    """A page that has done its work, as a client sees it that has kept nothing."""
    from kinseek.viewer.page import Page  # It imports viser.

    with patch.object(Page, "_fetch", lambda page: None):
        page = Page(browser or client(), session, Meshes(), motion)
        try:
            wait_until(lambda: page.idle, 60.0)
            yield page
        finally:
            page.close()


def function_arm() -> Arm:
    """A planar arm of two links of which only the function is known."""

    def fk(q: Any) -> Any:
        T = np.tile(np.eye(4), (len(q), 1, 1))
        T[:, 0, 3] = np.cos(q[:, 0]) + 0.5 * np.cos(q[:, 0] + q[:, 1])
        T[:, 1, 3] = np.sin(q[:, 0]) + 0.5 * np.sin(q[:, 0] + q[:, 1])
        return T

    return Arm.from_fk(fk, [-3.0, -2.0], [3.0, 2.0], names=["a", "b"])


def far(options: ViewerOptions) -> ViewerOptions:
    """Out of reach, and not so far that other units are suspected."""
    target = options.target.copy()
    target[:3, 3] *= 3.0
    return options.but(target=target)
