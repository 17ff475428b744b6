"""A drag in the viewer: 1,000 goals at 60 a second, on one core, and the memory of the server.

The server is a process of its own on one core. A program that speaks viser's protocol takes the place of the browser: it
opens the page, drags the gizmo as a mouse would, and receives everything that is sent. So the server is measured, and not
how fast a machine draws. Run: pytest benchmarks/test_viewer.py --benchmark-only -s
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

ARMS = ("ur5e", "panda", "scara4")

GOALS, RATE = 1_000, 60.0
"""Goals of a drag, and how many a second a browser sends."""

SERVER = """
import json, os, resource, sys
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {sorted(os.sched_getaffinity(0))[-1]})
import kinseek
from kinseek import viewer
from kinseek.viewer.page import Page
answered = [0]
solve = Page._solve
def counted(self, picked):
    solve(self, picked)
    answered[0] += 1
Page._solve = counted
def memory():
    with open("/proc/self/statm") as file:
        return int(file.read().split()[1]) * resource.getpagesize()
running = viewer.show(kinseek.load(sys.argv[1]), port=0, block=False, open_browser=False)
for line in sys.stdin:
    page = next(iter(running.pages.values()), None)
    told = {"port": running.port, "answered": answered[0], "memory": memory()}
    if page is not None:
        told |= {"goal": page.options.target.tolist(), "idle": page.idle}
        told |= {"cpu": sum(os.times()[:2])}
    print(json.dumps(told), flush=True)
running.stop()
"""


class Server:
    """The viewer in a process of its own."""

    def __init__(self, arm: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", SERVER, arm], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        assert self.process.stdout is not None
        self.process.stdout.readline()  # Where it is shown.

    def told(self) -> dict[str, Any]:
        """Its figures now."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write("?\n")
        self.process.stdin.flush()
        told: dict[str, Any] = json.loads(self.process.stdout.readline())
        return told

    def at_rest(self) -> dict[str, Any]:
        """Its figures when all is done."""
        while not (told := self.told()).get("idle"):
            time.sleep(0.1)
        return told

    def stop(self) -> None:
        """End it."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.close()
        self.process.wait(20)
        self.process.stdout.close()


class Visitor:
    """What a browser says, and a thread that takes what it is sent."""

    def __init__(self, port: int) -> None:
        import viser
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        self._socket = connect(
            f"ws://127.0.0.1:{port}",
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            compression=None,
        )
        self.frames = self.bytes = 0
        threading.Thread(target=self._take, daemon=True).start()
        self._send(
            "ViewerCameraMessage",
            {
                "wxyz": (1, 0, 0, 0),
                "position": (2, 2, 2),
                "fov": 0.8,
                "near": 0.1,
                "far": 100,
                "image_height": 800,
                "image_width": 1200,
                "look_at": (0, 0, 0),
                "up_direction": (0, 0, 1),
            },
        )

    def drag_to(self, T: Any) -> None:
        """Move the gizmo."""
        self._send(
            "TransformControlsUpdateMessage",
            {
                "name": "/goal",
                "wxyz": (1.0, 0.0, 0.0, 0.0),
                "position": tuple(map(float, T[:3, 3])),
                "owner": "0",
            },
        )

    def _take(self) -> None:
        for frame in self._socket:
            self.frames += 1
            self.bytes += len(frame)

    def _send(self, kind: str, values: dict[str, Any]) -> None:
        import msgspec

        self._socket.send(msgspec.msgpack.encode({"type": kind, **values}))

    def close(self) -> None:
        """Leave."""
        self._socket.close()


@pytest.fixture
def server(request: pytest.FixtureRequest) -> Iterator[Server]:
    pytest.importorskip("viser")
    running = Server(request.param)
    yield running
    running.stop()


def way(centre: Any, number: int, size: float) -> Any:
    """A goal of a drag: around and around its beginning, farther and farther."""
    T, angle = np.array(centre), 2 * np.pi * number / 100
    T[:3, 3] += (
        size * (0.2 + 0.8 * number / GOALS) * np.array([np.cos(angle), np.sin(angle), np.sin(0.3 * angle)])
    )
    return T


def drag(server: Server, visitor: Visitor, centre: Any) -> dict[str, float]:
    """Drag at the browser's rate; what was answered by the end of it, and how long it took."""
    before, frames, sent = server.told(), visitor.frames, visitor.bytes
    began = time.monotonic()
    for number in range(GOALS):
        while time.monotonic() < began + number / RATE:
            time.sleep(0.001)
        visitor.drag_to(way(centre, number, 0.05))
    seconds = time.monotonic() - began
    after = server.told()
    return {
        "answers a second": (after["answered"] - before["answered"]) / seconds,
        "frames a second": (visitor.frames - frames) / seconds,
        "kB a second": (visitor.bytes - sent) / seconds / 1e3,
        "part of a core": (after["cpu"] - before["cpu"]) / seconds,
    }


@pytest.mark.parametrize("server", ARMS, indirect=True)
def test_a_drag_keeps_up_and_memory_does_not_grow(benchmark: Any, server: Server) -> None:
    visitor = Visitor(server.told()["port"])
    centre = server.at_rest()["goal"]
    drag(server, visitor, centre)  # What is made once is made now.
    memory = server.at_rest()["memory"]
    figures = benchmark.pedantic(drag, (server, visitor, centre), rounds=1)
    grown = server.at_rest()["memory"] - memory
    figures |= {"grown MB": grown / 1e6, "memory MB": memory / 1e6}
    visitor.close()
    benchmark.extra_info.update(figures)
    print("\n", *(f"{name} {value:.4g};" for name, value in figures.items()))
    assert figures["answers a second"] > 0.97 * RATE
    assert figures["frames a second"] > 0.9 * RATE
    assert grown < 4e6
