"""Access control of a page: viser itself accepts requests from every site, and trusts the messages that it receives.

A page of any site that is open in the user's browser can connect to a server on this machine. The browser reports the page's
site in `Origin`. A name whose owner points it at this machine later (DNS rebinding) is visible in `Host`. Both are checked
before any reply. Messages that no page of kinseek sends are ignored.

viser's page connects to any server that its address names, and runs the JavaScript that this server sends. A link on a
foreign page could thus run foreign code as a page of this server. Such addresses are rejected, and a policy restricts the
page's connections to its own server.

viser answers a request for ``/C:/file`` on Windows with that file, whoever asks. Such requests are rejected, too.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import re
import sys
from collections.abc import Callable, Mapping
from functools import cache
from http import HTTPStatus
from ipaddress import ip_address
from types import FunctionType, MethodType
from typing import Any, Literal
from urllib.parse import parse_qsl, unquote

from kinseek.errors import InvalidUse

SUPPORTED = "viser>=1.1.1,<1.2"
"""Versions of viser whose server is supported; the extra `view` requires the same."""

MOST_MESSAGE = 2**20
"""Maximum size of a message from a page [bytes]; the longest is the state kept by a browser."""
MESSAGE_TIME, BYTE_TIME = 1 / 500, 1 / 2**22
"""Time for a message from a page, or for a fragment of one, and for each of its bytes [s]; the next messages wait for the
time of those before them. A page sends a hundred short messages a second while a goal is dragged. See `AHEAD`."""
AHEAD = 0.5
"""Time of messages [s] that are taken without waiting, such as those of a page that has just opened."""
MOST_WAITING = 1
"""Number of messages of a page, or fragments of them, that wait to be taken before no more are read."""
MOST_CONNECTIONS = 100
"""Maximum number of open connections: a page has one, with eight threads and one or two megabytes."""
MOST_TEXT = 200
"""Maximum length of a name, or of typed text."""
FAR = 1e9
"""Maximum number in a message, for lengths in metres, angles and pixels."""

POLICY = "connect-src 'self' data: blob:"
"""Content-Security-Policy of the page. The page fetches the WebAssembly and images that it contains as ``data:`` and
``blob:``. Frames are not restricted, so that a notebook can show the page.
"""
_SERVER_KEYS = ("websocket", "playbackPath")
"""Query parameters with which viser's page takes its messages from elsewhere; the policy alone would allow ``data:``."""

_AUTHORITY = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::([0-9]{1,5}))?", re.IGNORECASE)
"""Pattern of a host and its port."""
_ORIGIN = re.compile(r"(https?)://(.+)", re.IGNORECASE)
_PORTS = {"http": "80", "https": "443"}
_PROTOCOL = re.compile(r"viser-v[0-9A-Za-z.+-]{1,32}")
"""Pattern of the version that a page reports."""

_log = logging.getLogger("kinseek.viewer.connections")
_log.addHandler(logging.NullHandler())  # Without a handler Python would print broken requests on stderr.


def is_loopback(host: str) -> bool:
    """Return whether only this machine can reach a host."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def refusal(headers: Any, alone: bool, name: str = "localhost") -> str:
    """Return why a request is rejected; empty if it is accepted.

    Args:
        headers: Headers of the request, as websockets returns them.
        alone: Does the server listen for this machine only? Then the host must be a loopback address or a name of it.
        name: The name of this machine with which the server was started.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    # With two Host headers, another reader of the request may use the other one.
    host = _AUTHORITY.fullmatch(hosts[0]) if len(hosts) == 1 else None
    if host is None:
        return "The request does not say to which host it goes."
    # Against DNS rebinding: another site may give its name the address of this machine, and its pages then pass the check
    # of `Origin`.
    requested = host[1].strip("[]").lower()
    if alone and requested != name.lower() and not is_loopback(requested):
        return "This page is for this machine alone: open it at 127.0.0.1 or localhost."
    if len(origins) > 1 or (origins and not _is_of(origins[0], host)):
        return "The request comes from a page of another site."
    protocols = ", ".join(headers.get_all("Sec-WebSocket-Protocol"))
    if headers.get_all("Upgrade") and not _PROTOCOL.fullmatch(protocols):
        return "The request is not from a page of this server."
    return ""


def names_a_server(path: str) -> bool:
    """Return whether the query of a request would make the page take its messages from elsewhere."""
    query = path.partition("?")[2]
    return any(key in _SERVER_KEYS for key, _ in parse_qsl(query, keep_blank_values=True))


def names_a_drive(path: str) -> bool:
    """Return whether a request may name a file outside of the page's folder: on Windows ``/C:/file`` leads to the drive."""
    return ":" in unquote(path.partition("?")[0])


def _is_of(origin: str, host: re.Match[str]) -> bool:
    """Return whether the page belongs to the requested host. The port counts: other servers may use other ports here."""
    found = _ORIGIN.fullmatch(origin)
    place = _AUTHORITY.fullmatch(found[2]) if found else None
    if found is None or place is None:
        return False
    usual = _PORTS[found[1].lower()]
    return (place[1].lower(), place[2] or usual) == (host[1].lower(), host[2] or usual)


class Door:
    """The access control in front of a viser server."""

    def __init__(self, alone: bool, name: str, anyone: bool = False) -> None:
        """Set who has access.

        Args:
            alone: Does the server listen for this machine only?
            name: The host with which it was started.
            anyone: Accept all requests, because they come through a relay?
        """
        self._alone, self._name, self._anyone = alone, name, anyone
        self._there = False

    def put_before(self, server: Any) -> None:
        """Install the checks in viser's `WebsockServer`, which has not been started.

        viser calls `websockets.asyncio.server.serve` and offers no way to pass options to it. For this server alone, its
        method looks up other names here; other servers of the process are unchanged.

        Raises:
            InvalidUse: This version of viser has no such method.
        """
        try:
            method = type(server)._background_worker
            names = vars(sys.modules[method.__module__])
            serve = _Instead(names["websockets"], ["asyncio", "server", "serve"], self._serve)
            server._background_worker = MethodType(
                FunctionType(method.__code__, {**names, "websockets": serve}), server
            )
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise _unsupported() from error

    def require(self) -> None:
        """Check that viser has used the installed function.

        Raises:
            InvalidUse: It has not: this version of viser serves in another way.
        """
        if not self._there:
            raise _unsupported()

    def _serve(self, handler: Any, *where: Any, **options: Any) -> Any:
        """Replacement of `websockets.asyncio.server.serve`, called by viser in the server's own loop."""
        from viser import __version__
        from websockets.asyncio.server import ServerConnection, serve
        from websockets.frames import CTRL_OPCODES, CloseCode

        self._there = True
        asyncio.get_running_loop().set_exception_handler(_log_exception)
        process_request = options["process_request"]

        def checked(connection: Any, request: Any) -> Any:
            # Before viser handles the request, so that a rejected page learns nothing.
            why = "" if self._anyone else refusal(request.headers, self._alone, self._name)
            if names_a_server(request.path):
                why = why or "This page connects to its own server only."
            if names_a_drive(request.path):
                why = why or "This server has the files of its page only."
            if why:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
            try:
                return process_request(connection, request)
            except OSError:  # A name that is too long for a file.
                return connection.respond(HTTPStatus.NOT_FOUND, "NOT FOUND")

        def with_policy(connection: Any, request: Any, reply: Any) -> None:
            """Add the policy to every reply, including those of websockets itself."""
            reply.headers["Content-Security-Policy"] = POLICY

        class Connection(ServerConnection):
            """A connection that ignores messages that no page sends, and takes no more than a page sends."""

            def connection_made(self, transport: asyncio.BaseTransport) -> None:
                super().connection_made(transport)
                self._messages, self._controls = _Pace(), _Pace()
                if len(self.server.handlers) > MOST_CONNECTIONS:
                    self.transport.abort()

            def process_event(self, event: Any) -> None:
                super().process_event(event)
                if getattr(event, "opcode", None) not in CTRL_OPCODES:
                    return
                # Answers to pings are kept until they are read, without a limit, and nothing waits for them. Browsers send
                # none, and proxies a few a minute.
                if self._controls.ahead(MESSAGE_TIME) > AHEAD:
                    self.transport.abort()

            async def recv(self, *args: Any, **named: Any) -> Any:
                while True:
                    # Joined at once: `super().recv` would keep empty fragments without end, about 100 bytes for each.
                    message = bytearray()
                    async for fragment in self.recv_streaming(decode=False):
                        message += fragment
                        ahead = self._messages.ahead(MESSAGE_TIME + BYTE_TIME * len(fragment))
                        # A page that sends without end waits here, so that the others do not wait for it.
                        if ahead > AHEAD:
                            await asyncio.sleep(ahead - AHEAD)
                    if is_message(whole := bytes(message)):
                        return whole

            def send_data(self) -> None:
                # As in the base class, except that nothing is written once the page has left: asyncio would print a line for
                # every answer to a ping.
                for data in self.protocol.data_to_send():
                    if self.transport.is_closing():
                        continue
                    if data:
                        self.transport.write(data)
                    elif self.transport.can_write_eof():
                        with contextlib.suppress(OSError, RuntimeError):
                            self.transport.write_eof()
                    else:
                        self.transport.close()

        async def of_this_version(connection: Any) -> None:
            # viser would print a line for every other one, and its server would end if nobody reads the output.
            if connection.subprotocol == f"viser-v{__version__}":
                await handler(connection)
            else:
                await connection.close(CloseCode.PROTOCOL_ERROR, "Another version of viser made this page")

        options |= {"process_request": checked, "process_response": with_policy}
        options |= {"create_connection": Connection, "logger": _log}
        options |= {"max_size": MOST_MESSAGE, "max_queue": MOST_WAITING}
        return serve(of_this_version, *where, **options)


class _Pace:
    """How far a page is ahead of the rate at which it may send."""

    _until = 0.0

    def ahead(self, cost: float) -> float:
        """Count something that takes a time [s]; return how far the page is ahead now [s]."""
        now = asyncio.get_running_loop().time()
        self._until = max(self._until, now) + cost
        return self._until - now


def _unsupported() -> InvalidUse:
    import viser

    return InvalidUse(
        f"the viewer cannot check who connects with viser {viser.__version__}: pip install {SUPPORTED!r}"
    )


class _Instead:
    """A module in which one function, possibly in a submodule, is replaced."""

    def __init__(self, module: Any, names: list[str], function: Any) -> None:
        self._module, (name, *rest) = module, names
        inner = getattr(module, name)
        setattr(self, name, _Instead(inner, rest, function) if rest else function)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


def _log_exception(loop: Any, context: Mapping[str, Any]) -> None:
    """Log an exception in a message handler; asyncio would print it."""
    _log.debug("%s", context.get("message"), exc_info=context.get("exception"))


def is_message(data: Any) -> bool:
    """Return whether data are a message that a page of kinseek can send, with valid values."""
    from msgspec import MsgspecError

    if not isinstance(data, bytes):
        return False
    try:
        message = _decoder().decode(data)
    except (MsgspecError, ValueError, RecursionError):
        return False
    fields = MESSAGES.get(message.pop("type", None)) if isinstance(message.get("type"), str) else None
    if fields is None or not message.keys() <= fields.keys():
        return False
    return all(sound(message[name]) if name in message else name == "owner" for name, sound in fields.items())


@cache
def _decoder() -> Any:
    """Return a decoder that stops at a key that no message has, and at lists of anything but numbers.

    A million empty lists in one message would keep the garbage collector busy, and with it the pages of others.
    """
    from msgspec import msgpack

    literal: Any = Literal
    names = literal[("type", *{name for fields in MESSAGES.values() for name in fields})]
    plain: Any = bool | float | int | str | list[float | int] | None
    mapping: Any = dict
    return msgpack.Decoder(mapping[names, plain | dict[Literal["value"], plain]])


def _number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FAR


def _pixels(value: Any) -> bool:
    return _number(value) and value >= 1


def _index(value: Any) -> bool:
    return value is None or (_number(value) and isinstance(value, int) and value >= 0)


def _text(value: Any) -> bool:
    return isinstance(value, str) and len(value) <= MOST_TEXT


def _word(value: Any) -> bool:
    return value is None or _text(value)


def _text_or_none(value: Any) -> bool:
    return value is None or isinstance(value, str)


def _numbers(count: int) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and len(value) == count and all(map(_number, value))


def _turn(value: Any) -> bool:
    """Return whether a value is a unit quaternion; browsers compute with fewer digits."""
    return _numbers(4)(value) and abs(math.hypot(*value) - 1.0) < 1e-3


def _updates(value: Any) -> bool:
    """Return whether a value is valid for an input; viser would also accept anything else."""
    if not isinstance(value, dict) or value.keys() != {"value"}:
        return False
    new = value["value"]
    return isinstance(new, bool) or _number(new) or _text(new) or _numbers(3)(new)


MESSAGES: Mapping[str, Mapping[str, Callable[[Any], bool]]] = {
    "ViewerCameraMessage": {
        "wxyz": _turn,
        "position": _numbers(3),
        "fov": _number,
        "near": _number,
        "far": _number,
        "image_height": _pixels,
        "image_width": _pixels,
        "look_at": _numbers(3),
        "up_direction": _numbers(3),
    },
    "TransformControlsUpdateMessage": {"name": _text, "wxyz": _turn, "position": _numbers(3), "owner": _text},
    "TransformControlsDragStartMessage": {"name": _text, "owner": _text},
    "TransformControlsDragEndMessage": {"name": _text, "owner": _text},
    "SceneNodeClickMessage": {
        "name": _text,
        "instance_index": _index,
        "ray_origin": _numbers(3),
        "ray_direction": _numbers(3),
        "screen_pos": _numbers(2),
        "modifier": _word,
        "owner": _text,
    },
    "GuiUpdateMessage": {"uuid": _text, "updates": _updates},
    "LocalStorageGetItemResponseMessage": {
        "value": _text_or_none,
        "error": _text_or_none,
        "request_uuid": _text,
    },
}
"""Messages from pages, with a check for each field; viser's other messages are for features that kinseek does not use."""
