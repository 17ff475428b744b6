"""Who may open a page, and which messages are read: viser itself lets every site in and believes what it is sent.

A page of any site that is open in the user's browser can connect to a server on this machine. The browser says from where,
in `Origin`; a name that its owner points at this machine later (DNS rebinding) is seen in `Host`. Both are checked before
anything is answered. Messages that no page sends are ignored.

viser's page connects to any server that its address names, and runs the JavaScript that this server sends. A link on a
foreign page could thus run foreign code as a page of this server. Such addresses are refused, and a policy tells the browser
that the page connects to its own server only.
"""

from __future__ import annotations

import asyncio
import logging
import math
import re
import sys
from collections.abc import Callable, Mapping
from http import HTTPStatus
from ipaddress import ip_address
from types import FunctionType, MethodType
from typing import Any
from urllib.parse import parse_qsl

from kinseek.errors import InvalidUse

SUPPORTED = "viser>=1.1.1,<1.2"
"""Versions whose server is known; the extra `view` asks for the same."""

MOST_MESSAGE = 2**20
"""Bytes of a message from a page; what a browser keeps is the longest."""
MOST_TEXT = 200
"""Letters of a name, or of what is typed."""
FAR = 1e9
"""No number of a page is larger: it is of lengths in metres, of angles, or of pixels."""

POLICY = "connect-src 'self' data: blob:"
"""Content-Security-Policy of the page. It fetches the WebAssembly and images that it holds as ``data:`` and ``blob:``.
Frames are not limited, so that a notebook can show the page."""
_SERVER_KEYS = ("websocket", "playbackPath")
"""Parts of a query by which viser's page takes its messages from elsewhere; the policy alone would allow ``data:``."""

_AUTHORITY = re.compile(r"(\[[0-9a-f:.]+\]|[a-z0-9._-]+)(?::([0-9]{1,5}))?", re.IGNORECASE)
"""A host and its port."""
_ORIGIN = re.compile(r"(https?)://(.+)", re.IGNORECASE)
_PORTS = {"http": "80", "https": "443"}
_PROTOCOL = re.compile(r"viser-v[0-9A-Za-z.+-]{1,32}")
"""By which a page says what version it is: viser prints it, if it is another one."""

_log = logging.getLogger("kinseek.viewer.connections")
_log.addHandler(logging.NullHandler())  # Without any handler Python would print broken requests on stderr.


def is_loopback(host: str) -> bool:
    """Does only this machine reach it?"""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def refusal(headers: Any, alone: bool) -> str:
    """Why a request is refused; empty if it is not.

    Args:
        headers: Those of the request, as websockets gives them.
        alone: Does the server listen for this machine alone? Then the host has to be a name of it.
    """
    hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
    host = _AUTHORITY.fullmatch(hosts[0]) if len(hosts) == 1 else None
    if host is None:
        return "The request does not say to which host it goes."
    if alone and not is_loopback(host[1].strip("[]").lower()):
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


def _is_of(origin: str, host: re.Match[str]) -> bool:
    """Is the page of the host that it asks? The port counts: others on this machine may serve pages, too."""
    found = _ORIGIN.fullmatch(origin)
    place = _AUTHORITY.fullmatch(found[2]) if found else None
    if found is None or place is None:
        return False
    usual = _PORTS[found[1].lower()]
    return (place[1].lower(), place[2] or usual) == (host[1].lower(), host[2] or usual)


class Door:
    """What stands before a server of viser."""

    def __init__(self, alone: bool, anyone: bool = False) -> None:
        """Say who may come.

        Args:
            alone: Does the server listen for this machine alone?
            anyone: Is no request refused, since it comes by a relay?
        """
        self._alone, self._anyone = alone, anyone
        self._there = False

    def put_before(self, server: Any) -> None:
        """Stand before viser's `WebsockServer`, which has not been started.

        viser calls `websockets.asyncio.server.serve` and offers no way to give it options. Its method gets other names to
        look up here, of this server alone: nothing changes for other servers of the process.

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
        """Make sure that the server has come by.

        Raises:
            InvalidUse: It has not: this version of viser serves in another way.
        """
        if not self._there:
            raise _unsupported()

    def _serve(self, handler: Any, *where: Any, **options: Any) -> Any:
        """What viser calls for `websockets.asyncio.server.serve`, in the server's own loop."""
        from websockets.asyncio.server import ServerConnection, serve

        self._there = True
        asyncio.get_running_loop().set_exception_handler(_log_exception)
        ask = options["process_request"]

        def checked(connection: Any, request: Any) -> Any:
            why = "" if self._anyone else refusal(request.headers, self._alone)
            if names_a_server(request.path):
                why = why or "This page connects to its own server only."
            if why:
                return connection.respond(HTTPStatus.FORBIDDEN, f"{why}\n")
            try:
                return ask(connection, request)
            except OSError:  # A name that is too long for a file.
                return connection.respond(HTTPStatus.NOT_FOUND, "NOT FOUND")

        def with_policy(connection: Any, request: Any, reply: Any) -> None:
            """Every reply has it, also those of websockets itself."""
            reply.headers["Content-Security-Policy"] = POLICY

        class Connection(ServerConnection):
            """One that ignores what no page sends."""

            async def recv(self, *args: Any, **named: Any) -> Any:
                while not is_message(message := await super().recv(*args, **named)):
                    pass
                return message

        options |= {"process_request": checked, "process_response": with_policy}
        options |= {"create_connection": Connection, "logger": _log}
        return serve(handler, *where, **{**options, "max_size": MOST_MESSAGE})


def _unsupported() -> InvalidUse:
    import viser

    return InvalidUse(
        f"the viewer cannot check who connects with viser {viser.__version__}: pip install {SUPPORTED!r}"
    )


class _Instead:
    """A module with another function in it, or in a module in it."""

    def __init__(self, module: Any, names: list[str], function: Any) -> None:
        self._module, (name, *rest) = module, names
        inner = getattr(module, name)
        setattr(self, name, _Instead(inner, rest, function) if rest else function)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._module, name)


def _log_exception(loop: Any, context: Mapping[str, Any]) -> None:
    """A message that made a fault ends there; asyncio would print it."""
    _log.debug("%s", context.get("message"), exc_info=context.get("exception"))


def is_message(data: Any) -> bool:
    """Is it a message that a page of kinseek sends, with values that it sends?"""
    from msgspec import MsgspecError, msgpack

    if not isinstance(data, bytes):
        return False
    try:
        message = msgpack.decode(data)
    except (MsgspecError, ValueError, RecursionError):
        return False
    if not isinstance(message, dict):
        return False
    fields = MESSAGES.get(message.pop("type", None)) if isinstance(message.get("type"), str) else None
    if fields is None or not message.keys() <= fields.keys():
        return False
    return all(sound(message[name]) if name in message else name == "owner" for name, sound in fields.items())


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


def _kept(value: Any) -> bool:
    return value is None or isinstance(value, str)


def _numbers(count: int) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, list) and len(value) == count and all(map(_number, value))


def _turn(value: Any) -> bool:
    """A unit quaternion; browsers compute with fewer digits."""
    return _numbers(4)(value) and abs(math.hypot(*value) - 1.0) < 1e-3


def _updates(value: Any) -> bool:
    """The value of an input; viser would set anything else of it as well."""
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
    "LocalStorageGetItemResponseMessage": {"value": _kept, "error": _kept, "request_uuid": _text},
}
"""What pages send, with a test for each field; other messages of viser are for what kinseek does not use, as uploads."""
