"""An arm in the browser: drag its goal, and see the solution, every branch, and its errors (extra ``view``).

>>> import kinseek
>>> from kinseek import viewer
>>> viewer.show(kinseek.load("ur5e"))        # doctest: +SKIP

All results are computed by `Arm`. `session` solves goals, `clouds` does slower computations, `drawing`, `bodies` and
`meshes` draw the arm and its scene. `page`, `view` and `panel` show it to one person with viser.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from kinseek.arm import Arm
from kinseek.collision import Scene
from kinseek.errors import InvalidUse
from kinseek.printable import printable
from kinseek.timing.trajectory import Trajectory

from .server import Viewer, browser_here, open_page

__all__ = ["Viewer", "show"]


def show(
    arm: Arm,
    *,
    trajectory: Trajectory | None = None,
    scene: Scene | None = None,
    clearance: float = 0.0,
    host: str = "127.0.0.1",
    port: int = 8080,
    share: bool = False,
    open_browser: bool | None = None,
    block: bool = True,
    packages: Mapping[str, str | Path] | None = None,
) -> Viewer:
    """Show an arm on a page in the browser, with a goal to drag.

    Everyone who opens the page has a goal of their own. Their settings are kept in their browser.

    Args:
        arm: Any arm; with black-box kinematics only the tip is shown, and nothing can be proved.
        trajectory: A motion of this arm, to be played in real time or moved through by a slider.
        scene: The collision scene of this arm, see docs/collisions.md. Its bodies are drawn, what the arm hits is red, and
            solutions avoid collisions.
        clearance: Minimum distance between bodies of the scene [m].
        host: Address to listen at. The default is reachable from this machine only; ``"0.0.0.0"`` accepts the network. Pages
            of other sites are rejected.
        port: Port to listen at; if it is taken, the next free one is used and reported. 0 uses any free port.
        share: Make a public address through viser's own relay, share.viser.studio. Anyone who has it can use the page.
        open_browser: Open a browser; by default if there is a screen.
        block: Wait until Ctrl-C. Otherwise the viewer runs beside the program until `Viewer.stop`.
        packages: Folders of ROS packages by name, if a robot's file names meshes as ``package://``.

    Returns:
        The viewer; with `block` it has stopped.

    Raises:
        MissingExtra: viser is not installed.
        InvalidProblem: A clearance without a scene.
        InvalidScene: Not a scene of this arm, or the clearance is not a length.
        InvalidUse: Not an arm, a trajectory of another arm or one that takes no time, an address that is not this
            machine's, no free port, or an unsupported version of viser.
    """
    if not isinstance(arm, Arm):
        raise InvalidUse(f"show takes an Arm, as kinseek.load gives it, got {type(arm).__name__}")
    if trajectory is not None:
        _require_motion(trajectory, arm)
    clearance = arm._clearance(scene, clearance)
    viewer = Viewer(arm, host, port, share, packages, trajectory, scene, clearance)
    try:
        _announce(viewer, browser_here() if open_browser is None else open_browser, share)
        if block:
            print("Ctrl-C ends it.", flush=True)
    except BaseException:  # Ctrl-C, or an output that nobody reads: nothing else would stop it.
        viewer.stop()
        raise
    if block:
        viewer.wait()
    return viewer


def _require_motion(trajectory: Trajectory, arm: Arm) -> None:
    """Reject what is no motion of an arm.

    Raises:
        InvalidUse: It is not.
    """
    if not isinstance(trajectory, Trajectory):
        raise InvalidUse(
            f"trajectory must be the result of path.timed() or arm.move(), got {type(trajectory).__name__}"
        )
    if trajectory.mechanism.joint_names != arm.joint_names:
        raise InvalidUse(
            f"the trajectory must be one of {arm.name!r} with joints {', '.join(arm.joint_names)}, got one of "
            f"{trajectory.mechanism.name!r} with joints {', '.join(trajectory.mechanism.joint_names)}"
        )
    q = trajectory.q(0.5 * trajectory.duration)
    if not np.allclose(trajectory.mechanism.forward(q[None])[0], arm.fk(q), rtol=0.0, atol=1e-9):
        raise InvalidUse(
            f"the trajectory is one of {trajectory.mechanism.name!r} with other lengths, or another tool, than those of "
            f"{arm.name!r}"
        )
    if trajectory.duration == 0.0:
        raise InvalidUse("the trajectory takes no time, so there is nothing to play")


def _announce(viewer: Viewer, open_browser: bool, share: bool) -> None:
    """Print where an arm is shown, and open a browser there."""
    if viewer.meshes.missing:
        count = len(viewer.meshes.missing)
        print(
            f"Drawn without {count} mesh{'es' if count > 1 else ''}:",
            *map(printable, viewer.meshes.report()),
            sep="\n  ",
        )
    if viewer.requested_port not in (0, viewer.port):
        print(f"Port {viewer.requested_port} is taken, so it is {viewer.port}.")
    if not viewer.alone:
        print(f"Everyone who reaches {viewer.host} can use this page.")
    opened = open_page(viewer.url) if open_browser else False
    print(
        f"{printable(viewer.arm.name)} is shown at {viewer.url}{'' if opened else ' - open it in a browser'}",
        flush=True,
    )
    if share:
        public = viewer.public_url or "not to be had: the relay does not answer"
        print(f"Public address: {printable(public)}", flush=True)  # The relay writes it.
