"""The server of pages: its address, access to it, and one page per client."""

from __future__ import annotations

import contextlib
import errno
import logging
import os
import socket
import sys
import threading
import webbrowser
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Self

import numpy as np

from kinseek.arm import Arm
from kinseek.collision import Scene
from kinseek.errors import InvalidUse, MissingExtra
from kinseek.printable import printable
from kinseek.support.validation import as_integer
from kinseek.timing.trajectory import Trajectory

from .door import Door, is_loopback
from .meshes import meshes_of
from .session import Session

_log = logging.getLogger("kinseek.viewer")

PORTS = 100
"""Number of ports that are tried, starting with the requested one."""


class Viewer:
    """A running viewer; made by `kinseek.viewer.show`, and a context manager that stops it."""

    def __init__(
        self,
        arm: Arm,
        host: str = "127.0.0.1",
        port: int = 8080,
        share: bool = False,
        packages: Mapping[str, str | Path] | None = None,
        trajectory: Trajectory | None = None,
        scene: Scene | None = None,
        clearance: float = 0.0,
    ) -> None:
        """Start serving; the arguments are those of `kinseek.viewer.show`."""
        try:
            import viser
        except ImportError:
            raise MissingExtra("The viewer", "view") from None
        from .page import Page

        class Server(viser.ViserServer):
            """A server that pages cannot make public: viser lets any page request that."""

            def request_share_url(self, verbose: bool = True) -> str | None:
                return super().request_share_url(verbose) if share else None

            def __setattr__(self, name: str, value: Any) -> None:
                if name == "_websock_server":  # Set first by viser, and started last.
                    door.put_before(value)
                super().__setattr__(name, value)

        free = free_port(host, port)
        self.alone = all(is_loopback(address[0]) for _, address in _addresses(host, free))
        """Can only this machine reach the page? A loopback address has other spellings and names, such as 127.1; and a name
        may also have an address of the network, at which viser listens too."""
        door = Door(self.alone, host, share)
        self.arm = arm
        self.meshes = meshes_of(arm.axes, packages)
        self._session = Session(arm, scene, clearance)
        with _silence():  # viser prints a greeting.
            self._server = Server(
                host=host, port=free, label=f"kinseek: {printable(arm.name)}", verbose=False
            )
        try:
            door.require()
        except InvalidUse:
            self._server.stop()
            raise
        self.port: int = self._server.get_port()
        self.requested_port = port
        self.host = host
        self.pages: dict[int, Page] = {}
        """The open pages, by the index of their connection."""
        self._lock = threading.Lock()
        self._stopped = threading.Event()
        self._server.gui.main_panel.dock_right()
        # Reflections and shadows show nothing about an arm, and take 20 s on a machine without a graphics card.
        self._server.scene.configure_environment_map(None)
        self._server.scene.configure_default_lights(cast_shadow=False)
        self._server.scene.add_light_ambient("/light", intensity=1.6)
        self._set_initial_camera()

        def lay_out(client: Any) -> None:
            # The client may leave at any time, also while its page is laid out.
            _leave_quietly(client)
            try:
                page = Page(client, self._session, self.meshes, trajectory)
            except Exception:  # viser would print it; usually a client left at once.
                if client.client_id in self._server.get_clients():
                    _log.exception("a page could not be laid out")
                return
            with self._lock:
                if client.client_id in self._server.get_clients():
                    self.pages[client.client_id] = page
                    return
            page.close()  # The client left before the layout was done.

        @self._server.on_client_connect
        async def _(client: Any) -> None:
            # Not in a thread of viser, which has 32 for all pages: a browser that does not answer holds it for seconds.
            name = f"kinseek page of client {client.client_id}"
            threading.Thread(target=lay_out, args=(client,), name=name, daemon=True).start()

        @self._server.on_client_disconnect
        def _(client: Any) -> None:
            with self._lock:
                page = self.pages.pop(client.client_id, None)
            if page is not None:
                page.close()

        self.public_url: str | None = self._server.request_share_url(verbose=False) if share else None

    def _set_initial_camera(self) -> None:
        """Set the initial camera: in front of the arm, above it, and to its side."""
        from .clouds import surroundings

        low, high = surroundings(self.arm)
        middle, size = (low + high) / 2, max(float((high - low).max()), 1e-3)
        camera = self._server.initial_camera
        camera.fov = np.radians(45.0)
        camera.position = middle + size * np.array([0.75, -0.95, 0.42])
        camera.look_at = middle
        camera.near, camera.far = size / 200, size * 100

    @property
    def url(self) -> str:
        """Address of the page, for a browser on this machine."""
        anywhere = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(self.host, self.host)
        return f"http://{f'[{anywhere}]' if ':' in anywhere else anywhere}:{self.port}"

    def stop(self) -> None:
        """Close every page and stop serving; a second call does nothing."""
        if self._stopped.is_set():
            return
        self._stopped.set()
        # viser reports this in the thread of its event loop.
        with contextlib.suppress(RuntimeError):  # Its loop is closed already.
            self._server.get_event_loop().call_soon_threadsafe(_silence().__enter__)
        self._server.stop()
        with self._lock:
            pages, self.pages = list(self.pages.values()), {}
        for page in pages:
            page.end()
        for page in pages:
            page.close()

    def wait(self) -> None:
        """Wait until `stop` is called or Ctrl-C is pressed, which stops it."""
        try:
            while not self._stopped.wait(0.5):
                pass
        except KeyboardInterrupt:
            self.stop()

    def __enter__(self) -> Self:
        """Return itself."""
        return self

    def __exit__(self, *_: object) -> None:
        """Stop."""
        self.stop()

    def __repr__(self) -> str:
        """The arm and the address."""
        return f"Viewer({self.arm.name!r}, {self.url!r})"


def free_port(host: str, port: int) -> int:
    """Return the first free port, starting with the requested one.

    Raises:
        InvalidUse: Not a port, not an address of this machine, or none is free.
    """
    port = as_integer("port, of which 0 is any free one,", port, 0, 65535, InvalidUse)
    addresses = _addresses(host, port)
    for number in range(port, min(port + PORTS, 65536)):
        try:
            for family, address in addresses:
                _try_port(family, address, number)
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                continue
            if error.errno in (errno.EACCES, errno.EPERM):
                raise InvalidUse(
                    f"port {number} is not available to this user; choose one from 1024 on"
                ) from None
            raise InvalidUse(
                f"host must be an address of this machine such as 127.0.0.1, got {host!r}: {error.strerror}"
            ) from None
        return number
    raise InvalidUse(f"no port from {port} to {min(port + PORTS, 65536) - 1} is free; choose another")


def _try_port(family: socket.AddressFamily, address: Any, port: int) -> None:
    """Listen at a port for a moment, as viser will; it waits forever for a server that cannot start.

    Raises:
        OSError: The port is in use, or not for this user.
    """
    with socket.socket(family, socket.SOCK_STREAM) as trial:
        # As asyncio's servers do: the port of a server that has just ended is free again. On Windows the option would
        # share a port that is in use.
        if os.name == "posix":
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        # They accept no IPv4 addresses in the form of IPv6.
        if family == socket.AF_INET6:
            trial.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        trial.bind((address[0], port, *address[2:]))
        trial.listen(1)


def _addresses(host: str, port: int) -> list[tuple[socket.AddressFamily, Any]]:
    """Return the family and the address of each address of a host.

    Raises:
        InvalidUse: It has none.
    """
    if (
        not isinstance(host, str) or not host
    ):  # An empty one, of a variable that is not set, would be all addresses.
        raise InvalidUse(f"host must be a name or an address such as '127.0.0.1', got {host!r:.200}")
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as error:
        raise InvalidUse(
            f"host must be an address of this machine such as 127.0.0.1, got {host!r}: {error}"
        ) from None
    return [(family, address) for family, *_, address in found]


def browser_here() -> bool:
    """Return whether there is a screen to open a browser on. A browser in a terminal would take the terminal over."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_page(url: str) -> bool:
    """Open a browser; return whether there was one."""
    try:
        return webbrowser.open(url)
    except (webbrowser.Error, OSError):
        return False


def _silence() -> contextlib.AbstractContextManager[Any]:
    """Suppress what this thread prints through Rich, as viser does; other threads are not affected."""
    from rich import get_console

    return get_console().capture()


def _leave_quietly(client: Any) -> None:
    """Keep viser from warning that a page has closed while threads still draw on it, which is not an error.

    viser warns once for each connection; this one is marked as warned. A filter would change the warnings of the process.
    """
    client._websock_connection.get_message_buffer()._warned_push_after_done = True
