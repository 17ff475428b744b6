"""An arm in the browser: drag its goal, and see the answer, every branch, and how near it comes (extra ``view``).

>>> import kinseek
>>> from kinseek import viewer
>>> viewer.show(kinseek.load("ur5e"))        # doctest: +SKIP

Nothing is computed here that `Arm` does not compute: what is asked and answered is in `session`, what takes longer in
`clouds`, how an arm is drawn in `drawing` and `meshes`; `page`, `scene` and `panel` show it to one person with viser.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from kinseek.arm import Arm
from kinseek.errors import InvalidUse
from kinseek.printable import printable

from .door import is_loopback
from .server import Viewer, browser_here, open_page

__all__ = ["Viewer", "show"]


def show(
    arm: Arm,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    share: bool = False,
    open_browser: bool | None = None,
    block: bool = True,
    packages: Mapping[str, str | Path] | None = None,
) -> Viewer:
    """Show an arm on a page in the browser, with a goal to drag.

    Everyone who opens the page has a goal of their own. What they set is kept in their browser.

    Args:
        arm: Any arm; of one that is a function the tip alone is shown, and nothing can be proved.
        host: Address to listen at. The default is reached from this machine alone; ``"0.0.0.0"`` lets the network in. Pages
            of other sites are refused.
        port: Port to listen at; if it is taken, the next free one is, and that is said. 0 takes any.
        share: Make a public address through viser's own relay, share.viser.studio. Whoever has it can use the page.
        open_browser: Open a browser; unless given, where there is a screen.
        block: Wait until Ctrl-C. Without it the viewer goes on beside the program, until `Viewer.stop`.
        packages: Folders of ROS packages by name, where a robot's file names meshes as ``package://``.

    Returns:
        The viewer; if it was waited for, it has stopped.

    Raises:
        MissingExtra: viser is not installed.
        InvalidUse: No arm, an address that is not this machine's, no free port, or a version of viser that is not known.
    """
    if not isinstance(arm, Arm):
        raise InvalidUse(f"show takes an Arm, as kinseek.load gives it, got {type(arm).__name__}")
    viewer = Viewer(arm, host, port, share, packages)
    if viewer.meshes.missing:
        count = len(viewer.meshes.missing)
        print(
            f"Drawn without {count} mesh{'es' if count > 1 else ''}:",
            *map(printable, viewer.meshes.report()),
            sep="\n  ",
        )
    if port not in (0, viewer.port):
        print(f"Port {port} is taken, so it is {viewer.port}.")
    if not is_loopback(host):
        print(f"Everyone who reaches {host} can use this page.")
    opened = open_page(viewer.url) if (browser_here() if open_browser is None else open_browser) else False
    print(
        f"{printable(arm.name)} is shown at {viewer.url}{'' if opened else ' - open it in a browser'}",
        flush=True,
    )
    if share:
        public = viewer.public_url or "not to be had: the relay does not answer"
        print(f"Public address: {public}", flush=True)
    if block:
        print("Ctrl-C ends it.", flush=True)
        viewer.wait()
    return viewer
