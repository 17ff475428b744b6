"""Who may open the viewer's page: no page of another site. What no page sends is ignored, and nothing is printed of it."""

from __future__ import annotations

import contextlib
import http.client
import importlib.util
import json
import socket
import threading
import time
import tracemalloc
import warnings
from collections.abc import Iterator
from functools import partial
from itertools import count
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidUse, viewer
from kinseek.viewer import door, server
from kinseek.viewer.door import MESSAGES, POLICY, is_message, refusal
from kinseek.viewer.page import Page
from viewer_pages import CAMERA, wait_until

viser = pytest.importorskip("viser")
msgspec = pytest.importorskip("msgspec")

import websockets  # noqa: E402, F401
from websockets.exceptions import ConnectionClosed, InvalidMessage, InvalidStatus  # noqa: E402
from websockets.sync.client import ClientConnection, connect  # noqa: E402

pytestmark = pytest.mark.slow

PROTOCOL = f"viser-v{viser.__version__}"
encode = msgspec.msgpack.encode
FRAME = encode(CAMERA)


@pytest.fixture(scope="module")
def shown() -> Iterator[viewer.Viewer]:
    arm, scene = kinseek.load("planar2"), None
    if importlib.util.find_spec("coal") is not None:
        scene = kinseek.Scene.of(arm, capsules=0.01)
        scene.add_box("wall", (0.1, 0.1, 0.1), kinseek.pose([0.0, 2.0, 0.0]))
    with viewer.show(arm, scene=scene, port=0, open_browser=False, block=False) as made:
        yield made


@pytest.fixture(scope="module")
def open_to_all() -> Iterator[viewer.Viewer]:
    with viewer.show(
        kinseek.load("planar2"), host="0.0.0.0", port=0, open_browser=False, block=False
    ) as made:
        yield made


PUBLIC = "https://arm.share.viser.studio"


@pytest.fixture(scope="module")
def shared() -> Iterator[viewer.Viewer]:
    arm = kinseek.load("planar2")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(viser.ViserServer, "request_share_url", lambda self, verbose=True: PUBLIC)
        made = viewer.show(arm, port=0, share=True, open_browser=False, block=False)
    with made:
        yield made


def websocket(port: int, host: str = "127.0.0.1", **options: Any) -> ClientConnection:
    """Connect to the port on this machine, under any name."""
    options = {"subprotocols": [PROTOCOL], "origin": f"http://{host}:{port}", **options}
    return connect(f"ws://{host}:{port}", sock=socket.create_connection(("127.0.0.1", port)), **options)


def reply(port: int, headers: dict[str, str], path: str = "/") -> tuple[int, bytes, list[str]]:
    """Ask for a path; `headers` has the host, too. Returns status, body and policies."""
    with contextlib.closing(http.client.HTTPConnection("127.0.0.1", port, timeout=10)) as request:
        request.putrequest("GET", path, skip_host=True)
        for name, value in headers.items():
            request.putheader(name, value)
        request.endheaders()
        response = request.getresponse()
        return response.status, response.read(), response.headers.get_all("Content-Security-Policy") or []


def page(port: int, headers: dict[str, str]) -> tuple[int, bytes]:
    """Ask for the page; `headers` has the host, too."""
    return reply(port, headers)[:2]


OTHERS = [
    "http://evil.test",
    "http://evil.test:{port}",
    "http://127.0.0.1",
    "http://127.0.0.1:1",
    "https://127.0.0.1.evil.test:{port}",
    "http://127.0.0.1:{port}@evil.test",
    "http://localhost:{port}",
    "ftp://127.0.0.1:{port}",
    "null",
    "",
]


@pytest.mark.parametrize("origin", OTHERS)
@pytest.mark.parametrize("where", ["shown", "open_to_all"])
def test_a_page_of_another_site_is_refused(where: str, origin: str, request: pytest.FixtureRequest) -> None:
    port = request.getfixturevalue(where).port
    origin = origin.format(port=port)
    with pytest.raises(InvalidStatus, match="403"):
        websocket(port, origin=origin)
    status, text = page(port, {"Host": f"127.0.0.1:{port}", "Origin": origin})
    assert (status, text) == (403, b"The request comes from a page of another site.\n")


@pytest.mark.parametrize(
    "host", ["evil.test", "192.168.0.7", "127.0.0.1.evil.test", "localhost.evil.test", "[::2]"]
)
def test_a_name_that_somebody_points_here_is_refused(host: str, shown: viewer.Viewer) -> None:
    with pytest.raises(InvalidStatus, match="403"):
        websocket(shown.port, host)
    with pytest.raises(InvalidStatus, match="403"):
        websocket(shown.port, host, origin=None)
    status, text = page(shown.port, {"Host": f"{host}:{shown.port}"})
    assert status == 403
    assert b"for this machine alone" in text


def test_another_name_of_loopback_is_for_this_machine_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    resolve = socket.getaddrinfo

    def with_alias(host: Any, *rest: Any, **options: Any) -> Any:
        return resolve("127.0.0.1" if host == "Workshop" else host, *rest, **options)

    monkeypatch.setattr(socket, "getaddrinfo", with_alias)
    for host in ("LOCALHOST", "127.1", "Workshop"):
        made = viewer.show(kinseek.load("planar2"), host=host, port=0, open_browser=False, block=False)
        with made:
            assert page(made.port, {"Host": f"evil.test:{made.port}"})[0] == 403, host
            for name in (host.lower(), "127.0.0.1"):
                assert page(made.port, {"Host": f"{name}:{made.port}"})[0] == 200, host


def test_a_name_with_an_address_of_the_network_is_not_for_this_machine_alone(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """viser listens at all addresses of a name, and only the first one was looked at."""
    family, kind = socket.AF_INET, socket.SOCK_STREAM
    found = [(family, kind, 6, "", (host, 0)) for host in ("127.0.0.1", "0.0.0.0")]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **options: found)
    assert [each[1][0] for each in server._addresses("box", 0)] == ["127.0.0.1", "0.0.0.0"]
    monkeypatch.undo()
    monkeypatch.setattr(server, "_addresses", lambda *_: [(family, each[4]) for each in found])
    made = viewer.show(kinseek.load("planar2"), host="localhost", port=0, open_browser=False, block=False)
    with made:
        assert not made.alone


@pytest.mark.parametrize("host", ["127.0.0.1", "localhost", "LOCALHOST", "[::1]", "127.0.0.2"])
def test_this_machine_is_let_in_by_any_of_its_names(host: str, shown: viewer.Viewer) -> None:
    with websocket(shown.port, host) as one:
        one.send(FRAME)
        assert one.recv(timeout=10)
    with websocket(shown.port, host, origin=None) as one:  # No browser.
        assert one.recv(timeout=10)
    assert page(shown.port, {"Host": f"{host}:{shown.port}"})[0] == 200
    # A port that is forwarded has another number.
    assert page(shown.port, {"Host": f"{host}:1234", "Origin": f"http://{host}:1234"})[0] == 200
    assert page(shown.port, {"Host": host, "Origin": f"https://{host}:443"})[0] == 200


def test_one_that_listens_for_others_has_any_name_and_pages_of_its_own_alone(
    open_to_all: viewer.Viewer,
) -> None:
    port = open_to_all.port
    with websocket(port, "workshop.example") as one:
        assert one.recv(timeout=10)
    assert page(port, {"Host": "workshop.example", "Origin": "http://workshop.example"})[0] == 200


@pytest.mark.parametrize(
    "query",
    [
        "websocket=ws://evil.test/",
        "websocket",
        "darkMode&websocket=ws://evil.test/",
        "%77ebsocket=ws://evil.test/",
        "playbackPath=https://evil.test/a.viser",
        "playbackPath=data:application/octet-stream;base64,AAAA",
        "a=1&&play%62ackPath=",
        "?&websocket=ws://evil.test/",
    ],
)
@pytest.mark.parametrize("path", ["/", "/index.html", "//"])
@pytest.mark.parametrize("where", ["shown", "open_to_all", "shared"])
def test_no_address_makes_the_page_listen_to_another_server(
    where: str, path: str, query: str, request: pytest.FixtureRequest
) -> None:
    port = request.getfixturevalue(where).port
    status, text, _ = reply(port, {"Host": f"127.0.0.1:{port}"}, f"{path}?{query}")
    assert (status, text) == (403, b"This page connects to its own server only.\n")


@pytest.mark.parametrize("path", ["/C:/secret", "/c%3A/secret", "/x/%43%3a%5Csecret", "/index.html:stream"])
@pytest.mark.parametrize("where", ["shown", "open_to_all", "shared"])
def test_no_address_names_a_drive_of_windows(where: str, path: str, request: pytest.FixtureRequest) -> None:
    port = request.getfixturevalue(where).port
    status, text, _ = reply(port, {"Host": f"127.0.0.1:{port}"}, path)
    assert (status, text) == (403, b"This server has the files of its page only.\n")


@pytest.mark.parametrize("where", ["shown", "open_to_all", "shared"])
def test_every_reply_says_that_the_page_connects_to_its_own_server_only(
    where: str, request: pytest.FixtureRequest
) -> None:
    port = request.getfixturevalue(where).port
    mine = {"Host": f"127.0.0.1:{port}"}
    for path, expected in (
        ("/", 200),
        ("/index.html?darkMode&a=websocket", 200),
        ("/?Websocket=1", 200),
        ("/nowhere", 404),
        ("/" + "a" * 5_000, 404),  # Longer than the name of a file can be.
        ("/?websocket=ws://evil.test/", 403),
    ):
        status, _, policies = reply(port, mine, path)
        assert (status, policies) == (expected, [POLICY]), path[:99]
    broken = {**mine, "Upgrade": "websocket", "Sec-WebSocket-Protocol": PROTOCOL}
    status, _, policies = reply(port, broken)
    assert (status, policies) == (426, [POLICY])


def headers(*given: tuple[str, str]) -> Any:
    from websockets import Headers

    return Headers(given)


def test_a_request_says_once_where_it_goes() -> None:
    assert "which host" in refusal(headers(), alone=False)
    assert "which host" in refusal(headers(("Host", "localhost"), ("Host", "localhost")), alone=False)
    for odd in ("a b", "user@localhost", "localhost:x", "localhost/", "", "[::1", "localhost:8080:1"):
        assert "which host" in refusal(headers(("Host", odd)), alone=False)
    twice = headers(("Host", "localhost"), ("Origin", "http://localhost"), ("Origin", "http://localhost"))
    assert "another site" in refusal(twice, alone=True)


@pytest.mark.parametrize(
    "protocols",
    [None, ["chat"], ["viser-v1\x1b"[:-1] + "]0;owned"], [PROTOCOL, "chat"], ["viser-v" + "1" * 99]],
)
def test_what_is_no_page_of_this_server_is_refused_and_not_printed(
    protocols: list[Any] | None, shown: viewer.Viewer, capfd: pytest.CaptureFixture[str]
) -> None:
    lines = [
        "GET / HTTP/1.1",
        f"Host: 127.0.0.1:{shown.port}",
        "Upgrade: websocket",
        "Connection: Upgrade",
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
        "Sec-WebSocket-Version: 13",
        *([f"Sec-WebSocket-Protocol: {', '.join(protocols)}"] if protocols else []),
    ]
    with socket.create_connection(("127.0.0.1", shown.port), timeout=10) as one:
        one.sendall("\r\n".join([*lines, "", ""]).encode())
        assert b"403" in one.recv(4096)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(("where", "protocols"), [("shown", ["viser-v9"]), ("shared", None)])
def test_a_page_of_another_version_is_closed_and_not_printed(
    where: str, protocols: list[Any] | None, request: pytest.FixtureRequest, capfd: pytest.CaptureFixture[str]
) -> None:
    port = request.getfixturevalue(where).port
    capfd.readouterr()  # It says where it is.
    with (
        websocket(port, subprotocols=protocols) as one,
        pytest.raises(ConnectionClosed, match=r"1002.*Another version of viser"),
    ):
        one.recv(timeout=10)
    assert capfd.readouterr() == ("", "")


def test_a_shared_page_is_reached_by_the_name_of_its_relay(shared: viewer.Viewer) -> None:
    assert shared.public_url == PUBLIC
    with websocket(shared.port, "arm.share.viser.studio", origin=PUBLIC) as one:
        assert one.recv(timeout=10)


def test_the_address_that_a_relay_gives_is_printed_with_escapes(
    shared: viewer.Viewer, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(shared, "public_url", f"{PUBLIC}\x1b]0;owned\x07")
    viewer._announce(shared, open_browser=False, share=True)
    assert f"Public address: {PUBLIC}\\x1b]0;owned\\x07\n" in capsys.readouterr().out


def test_another_version_of_viser_is_no_open_door(monkeypatch: pytest.MonkeyPatch) -> None:
    def serves_otherwise(self: Any, ready: Any) -> None:
        import asyncio

        from viser.infra._async_message_buffer import AsyncMessageBuffer

        self._background_event_loop = loop = asyncio.new_event_loop()
        self._stop_event = asyncio.Event()
        self._broadcast_buffer = AsyncMessageBuffer(loop, persistent_messages=True)
        ready.release()

    stopped: list[Any] = []
    assert "websockets" in globals()  # As in viser's module.
    monkeypatch.setattr(viser.infra.WebsockServer, "_background_worker", serves_otherwise)
    monkeypatch.setattr(viser.ViserServer, "stop", lambda self: stopped.append(self._event_loop))
    with pytest.raises(InvalidUse, match=r"cannot check who connects .* pip install 'viser>="):
        viewer.show(kinseek.load("planar2"), port=0, open_browser=False, block=False)
    (loop,) = stopped  # It would let everybody in.
    loop.close()
    monkeypatch.delattr(viser.infra.WebsockServer, "_background_worker")
    with pytest.raises(InvalidUse, match="cannot check who connects"):
        viewer.show(kinseek.load("planar2"), port=0, open_browser=False, block=False)


def test_other_servers_of_this_process_are_as_they_were(shown: viewer.Viewer) -> None:
    other = viser.ViserServer("127.0.0.1", port=0, verbose=False)
    try:
        assert page(other.get_port(), {"Host": "evil.test"})[0] == 200
    finally:
        other.stop()


ODD: list[Any] = [
    b"",
    b"\x00",
    b"\xc1" * 100,
    b"\x81" * 100_000,
    "text",
    [],
    1,
    {},
    {"type": 1},
    {"type": ["ViewerCameraMessage"]},
    {"type": "Message"},
    {"type": "__class__"},
    {"type": "ShareUrlRequest"},
    {"type": "FileTransferStartUpload", "transfer_uuid": "a"},
    {"type": "RunJavascriptMessage", "source": "alert(1)"},
    {"type": "ViewerCameraMessage"},
    {**CAMERA, "more": 1},
    {**CAMERA, "image_height": 0},
    {**CAMERA, "wxyz": [0, 0, 0, 0]},
    {**CAMERA, "wxyz": [1, 0, 0]},
    {**CAMERA, "wxyz": "1000"},
    {**CAMERA, "position": [float("nan"), 0, 0]},
    {**CAMERA, "position": [1e300, 0, 0]},
    {**CAMERA, "fov": None},
    {**CAMERA, "fov": True},
    {"type": "TransformControlsUpdateMessage", "name": "/goal", "wxyz": [0, 0, 0, 0], "position": [0, 0, 0]},
    {"type": "GuiUpdateMessage", "uuid": 3, "updates": {"value": 1}},
    {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"update_cb": []}},
    {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": {"a": 1}}},
    {"type": "GuiUpdateMessage", "uuid": "a", "updates": {"value": "x" * 1000}},
    {"type": "SceneNodeClickMessage", "name": "/a", "instance_index": -1},
    {"type": "LocalStorageGetItemResponseMessage", "value": 3, "error": None, "request_uuid": "a"},
]


def test_no_odd_message_is_taken_and_every_other_is() -> None:
    for odd in ODD:
        data = odd if isinstance(odd, bytes | str) else encode(odd)
        assert not is_message(data), odd
    assert is_message(FRAME)
    rng = np.random.default_rng(1)
    for _ in range(3000):
        data = bytearray(FRAME)
        data[int(rng.integers(len(data)))] = int(rng.integers(256))
        is_message(bytes(data))  # Says so, and raises nothing.


@pytest.mark.parametrize(
    "most",
    [
        b"\xdd\0\1\0\0" + b"\x90" * 2**16,
        b"\x81\xa4type\xdd\0\1\0\0" + b"\x90" * 2**16,
        b"\xdf\0\1\0\0" + b"".join(b"\xa4%04x\x90" % i for i in range(2**16)),
    ],
)
def test_a_message_of_lists_is_not_unpacked(most: bytes) -> None:
    assert not is_message(b"")  # It makes the decoder.
    tracemalloc.start()
    try:
        assert not is_message(most)
        assert tracemalloc.get_traced_memory()[1] < 2**20
    finally:
        tracemalloc.stop()


def test_messages_are_those_of_viser_with_all_their_fields() -> None:
    from viser import _messages
    from viser.infra._messages import wire_field_names

    for name, fields in MESSAGES.items():
        assert set(wire_field_names(getattr(_messages, name))) == set(fields)


@contextlib.contextmanager
def visit(shown: viewer.Viewer) -> Iterator[tuple[Any, Any]]:
    """A client and its page, which is gone in the end."""
    with websocket(shown.port) as one:
        one.send(FRAME)
        wait_until(lambda: shown.pages)
        (mine,) = shown.pages.values()
        yield one, mine
    wait_until(lambda: not shown.pages)


def test_angles_beyond_a_turn_turn_the_goal_without_a_warning(
    shown: viewer.Viewer, capfd: pytest.CaptureFixture[str]
) -> None:
    with visit(shown) as (one, mine):
        for yaw in (390.0, 1e6, -1e8):
            turn = {"value": [0.0, 0.0, yaw]}
            message = {"type": "GuiUpdateMessage", "uuid": mine.panel.turn._impl.uuid, "updates": turn}
            one.send(encode(message))
            expected = kinseek.pose([0.0, 0.0, 0.0], rpy=turn["value"], degrees=True)[:3, :3]
            wait_until(partial(turned_to, mine, expected))
    assert capfd.readouterr() == ("", "")


def test_a_goal_far_away_is_searched_without_a_warning(shown: viewer.Viewer) -> None:
    with warnings.catch_warnings(record=True) as warned, visit(shown) as (one, mine):
        warnings.simplefilter("always")
        wait_until(lambda: mine.idle)
        q = mine.result.q
        passes, place = (each._impl.uuid for each in (mine.panel.passes, mine.panel.place))
        one.send(encode({"type": "GuiUpdateMessage", "uuid": passes, "updates": {"value": True}}))
        wait_until(lambda: mine.panel.passes.value and mine.idle)
        for x in (1e5, 2e5):
            one.send(encode({"type": "GuiUpdateMessage", "uuid": place, "updates": {"value": [x, 0.0, 0.0]}}))
            wait_until(partial(placed_at, mine, x))
            wait_until(lambda: mine.idle)
        mine._ask(q)  # A branch of an earlier goal.
        wait_until(lambda: mine.idle)
    assert warned == []
    assert mine.result.refused


def placed_at(page: Any, x: float) -> bool:
    return bool(page.options.target[0, 3] == x)


def turned_to(page: Any, rotation: Any) -> bool:
    return np.allclose(page.options.target[:3, :3], rotation)


def test_odd_messages_print_nothing_and_the_page_goes_on(
    shown: viewer.Viewer, capfd: pytest.CaptureFixture[str]
) -> None:
    with websocket(shown.port) as one:
        for odd in ODD:
            one.send(odd if isinstance(odd, bytes | str) else encode(odd))
        one.send(FRAME)  # Now there is a page.
        wait_until(lambda: shown.pages)
        number, mine = next(iter(shown.pages.items()))
        handles = dict(shown._server.get_clients()[number].gui._gui_input_handle_from_uuid)
        sent: list[dict[str, Any]] = [
            {"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}}
            for uuid in handles
            for value in (10**8, -1, 0.5, "9" * 200, "nowhere", True, [0.0, 0.0, 0.0], [1e9, 1e9, -1e9])
        ]
        sent += [
            {
                "type": "TransformControlsUpdateMessage",
                "name": name,
                "wxyz": [1, 0, 0, 0],
                "position": [1e9] * 3,
            }
            for name in ("/goal", "/chosen", "/nowhere", "")
        ]
        click: dict[str, Any] = {
            "ray_origin": [0, 0, 0], "ray_direction": [0, 0, 0], "screen_pos": [0, 0], "modifier": None, "owner": ""
        }  # fmt: skip
        owner = shown._server.get_clients()[number].scene._owner_id
        sent += [
            {"type": "SceneNodeClickMessage", "name": name, "instance_index": index, **click, "owner": owner}
            for name in shown._server.get_clients()[number].scene._handle_from_node_name
            for index in (None, 0, 10**8)
        ]
        for each in sent:
            one.send(encode(each))
        one.send(FRAME)
        wait_until(lambda: mine.idle)
        search = mine.panel.search
        assert search.value in search.options
        follow = {"uuid": mine.panel.follow._impl.uuid, "updates": {"value": False}}
        one.send(encode({"type": "GuiUpdateMessage", **follow}))
        wait_until(lambda: not mine.options.follow)
    wait_until(lambda: not shown.pages)
    for rubbish in (
        b"\x00" * 100,
        b"GET / HTTP/9\r\n\r\n",
        b"\xff\xfe\r\n\r\n",
        b"GET /%00 HTTP/1.1\r\nHost: localhost\r\n\r\n",
    ):
        with socket.create_connection(("127.0.0.1", shown.port), timeout=10) as raw:
            raw.sendall(rubbish)
            raw.shutdown(socket.SHUT_WR)
            while raw.recv(4096):
                pass
    with websocket(shown.port) as one:
        one.send(b"\x00" * (2**20 + 1))  # Longer than any message.
        with contextlib.suppress(ConnectionClosed):
            while one.recv(timeout=10):
                pass
        assert one.close_code == 1009
    with websocket(shown.port) as one:
        assert one.recv(timeout=10)
    import gc

    gc.collect()  # Faults of tasks are told when these are forgotten.
    time.sleep(0.2)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "odd",
    [{"q": [1e308, 1e308]}, {"q": [-1e8, 0.0]}, {"camera": [[1e308] * 3, [-1e308] * 3]}],
    ids=["q too large for degrees", "q too large for fk", "camera"],
)
def test_what_a_browser_kept_prints_nothing(
    odd: dict[str, Any],
    shown: viewer.Viewer,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kept = json.dumps(json.loads(shown._session.begin.to_json()) | odd)
    monkeypatch.setattr(Page, "_fetch", lambda page: kept)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        with visit(shown) as (_, mine):
            wait_until(lambda: mine.idle)
            assert mine.result.reached
    assert (warned, capfd.readouterr()) == ([], ("", ""))


def test_options_are_kept_for_an_arm_whose_file_has_a_name_that_is_no_text() -> None:
    """The name went to the browser as it is, could not be encoded, and closed the page."""
    named = SimpleNamespace(name="\udcff.urdf", dof=6, base="base", tip="tip")
    key = Page._key.fget(SimpleNamespace(arm=named))  # type: ignore[attr-defined]
    assert key.encode()


def test_a_page_that_leaves_is_drawn_on_without_a_warning(shown: viewer.Viewer) -> None:
    with visit(shown) as (_, mine):
        wait_until(lambda: mine.idle)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mine.view.show_goal(np.eye(4))
        mine._client.scene.add_frame("/late")
        mine.panel.pass_text.content = "late"


def test_a_page_that_sends_without_end_waits_and_the_others_do_not(
    shown: viewer.Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(door, "MESSAGE_TIME", 0.02)
    wait_until(lambda: not shown.pages)
    with websocket(shown.port) as flooding, websocket(shown.port) as other:
        began = time.monotonic()
        for _ in range(100):
            flooding.send(b"nothing")
        flooding.send(FRAME)
        other.send(FRAME)
        wait_until(lambda: shown.pages)
        assert len(shown.pages) == 1  # That of the other.
        wait_until(lambda: len(shown.pages) == 2)
        assert (
            time.monotonic() - began > 3.0
        )  # 200 messages take 4 s, of which half a second is not waited for.


def test_a_fragment_without_bytes_counts_as_a_message_and_is_not_kept(
    shown: viewer.Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(door, "MESSAGE_TIME", 0.02)
    monkeypatch.setattr(Page, "_fetch", lambda page: None)  # It waits for what the browser has kept.
    wait_until(lambda: not shown.pages)
    with websocket(shown.port) as one:
        began = time.monotonic()
        one.send([*[b""] * 100, FRAME[:20], FRAME[20:]])
        wait_until(lambda: shown.pages)
        assert time.monotonic() - began > 1.3  # Half a second of two is not waited for.


def test_messages_that_wait_are_not_kept(shown: viewer.Viewer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(door, "MESSAGE_TIME", 10.0)
    length, taken = door.MOST_MESSAGE - 16, count()
    message = b"\x82\xff" + length.to_bytes(8, "big") + bytes(4) + b"\xc1" * length
    with websocket(shown.port) as flooding:
        flooding.socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 2**16)
        flooding.socket.settimeout(2.0)
        with contextlib.suppress(OSError):
            while next(taken) < 40:
                flooding.socket.sendall(message)
        assert (
            1 < next(taken) < 15
        )  # The system keeps about 6 MiB, and the server three; without a limit it took 22.
        with contextlib.suppress(OSError):
            flooding.socket.shutdown(socket.SHUT_RDWR)


def test_a_page_that_sends_pings_without_end_is_closed(shown: viewer.Viewer) -> None:
    with websocket(shown.port) as flooding, websocket(shown.port) as other:
        for _ in range(100):
            other.ping()
        with contextlib.suppress(OSError):
            flooding.socket.sendall(b"\x89\x80\0\0\0\0" * 1000)
        with pytest.raises(ConnectionClosed):
            list(flooding)
        assert other.ping().wait(10.0)


def test_pages_that_do_not_answer_do_not_delay_the_next(
    shown: viewer.Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer, silent, asked = threading.Event(), 40, count()

    def fetch(page: Any) -> None:
        if next(asked) < silent:
            answer.wait(60.0)

    monkeypatch.setattr(Page, "_fetch", fetch)
    wait_until(lambda: not shown.pages)
    with contextlib.ExitStack() as open_ones:
        open_ones.callback(answer.set)
        for _ in range(silent + 1):
            open_ones.enter_context(websocket(shown.port)).send(FRAME)
        wait_until(lambda: len(shown.pages) == 1)
    wait_until(lambda: not shown.pages)


def test_nothing_is_laid_out_for_a_page_that_has_left(
    shown: viewer.Viewer, monkeypatch: pytest.MonkeyPatch
) -> None:
    laid_out, done = list[Any](), threading.Event()
    fetch = Page._fetch

    def watched(page: Any) -> Any:
        try:
            laid_out.append(fetch(page))
            return laid_out[-1]
        finally:
            done.set()

    monkeypatch.setattr(Page, "_fetch", watched)
    wait_until(lambda: not shown.pages)
    with websocket(shown.port) as leaving:
        leaving.send(FRAME)
        assert leaving.recv(timeout=10)
    assert done.wait(10.0)
    assert laid_out == []


def test_further_connections_are_closed_until_one_leaves(
    shown: viewer.Viewer, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    wait_until(lambda: not shown.pages)
    monkeypatch.setattr(door, "MOST_CONNECTIONS", 2)
    with (
        websocket(shown.port),
        socket.create_connection(("127.0.0.1", shown.port)),
        pytest.raises((ConnectionClosed, InvalidMessage, OSError)),
    ):
        websocket(shown.port)

    answers = list[int]()

    def answered() -> bool:
        with contextlib.suppress(OSError):
            answers.extend([] if answers else [page(shown.port, {"Host": f"localhost:{shown.port}"})[0]])
        return answers == [200]

    wait_until(answered)
    assert capfd.readouterr() == ("", "")


def test_pings_of_a_page_that_has_left_print_nothing(
    shown: viewer.Viewer, caplog: pytest.LogCaptureFixture
) -> None:
    pings = b"\x89\x80\0\0\0\0" * 40_000
    with websocket(shown.port) as leaving:
        leaving.socket.settimeout(2.0)
        with contextlib.suppress(OSError):
            for _ in range(5):
                leaving.socket.sendall(pings)
        leaving.socket.shutdown(socket.SHUT_RDWR)
    # The server has read what was before.
    assert page(shown.port, {"Host": f"localhost:{shown.port}"})[0] == 200
    assert not [record for record in caplog.records if record.name == "asyncio"]
