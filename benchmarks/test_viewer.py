"""A drag in the viewer: 1,000 goals at 60 a second, on one core, and the memory of the server.

The server is a process of its own on one core. A program that speaks viser's protocol takes the place of the browser: it
opens the page, drags the gizmo as a mouse would, and receives everything that is sent. So the server is measured, and not
how fast a machine draws. Run: pytest benchmarks/test_viewer.py --benchmark-only -s
"""

from __future__ import annotations

import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.workers.process import Worker

ARMS = ("ur5e", "panda", "scara4")

GOALS, RATE = 1_000, 60.0
"""Goals of a drag, and how many a second a browser sends."""


def at_rest(server: Worker) -> dict[str, Any]:
    """The figures of the server when all is done."""
    while not (told := figures(server)).get("idle"):
        time.sleep(0.1)
    return told


def figures(server: Worker) -> dict[str, Any]:
    """The figures of the server now."""
    told: dict[str, Any] = server.ask("figures", 60)
    return told


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


def way(centre: Any, number: int, size: float) -> Any:
    """A goal of a drag: around and around its beginning, farther and farther."""
    T, angle = np.array(centre), 2 * np.pi * number / 100
    T[:3, 3] += (
        size * (0.2 + 0.8 * number / GOALS) * np.array([np.cos(angle), np.sin(angle), np.sin(0.3 * angle)])
    )
    return T


def drag(server: Worker, visitor: Visitor, centre: Any) -> dict[str, float]:
    """Drag at the browser's rate; what was answered by the end of it, and how long it took."""
    before, frames, sent = figures(server), visitor.frames, visitor.bytes
    began = time.monotonic()
    for number in range(GOALS):
        while time.monotonic() < began + number / RATE:
            time.sleep(0.001)
        visitor.drag_to(way(centre, number, 0.05))
    seconds = time.monotonic() - began
    after = figures(server)
    return {
        "answers a second": (after["answered"] - before["answered"]) / seconds,
        "frames a second": (visitor.frames - frames) / seconds,
        "kB a second": (visitor.bytes - sent) / seconds / 1e3,
        "part of a core": (after["cpu"] - before["cpu"]) / seconds,
    }


@pytest.mark.parametrize("arm", ARMS)
def test_a_drag_keeps_up_and_memory_does_not_grow(benchmark: Any, arm: str, tmp_path: Path) -> None:
    pytest.importorskip("viser")
    server = Worker(Path(sys.executable), "benchmarks.workers.viewer", tmp_path / "log.txt")
    visitor = Visitor(server.ask("begin", 60, arm=arm))
    centre = at_rest(server)["goal"]
    drag(server, visitor, centre)  # What is made once is made now.
    memory = at_rest(server)["memory"]
    found = benchmark.pedantic(drag, (server, visitor, centre), rounds=1)
    grown = at_rest(server)["memory"] - memory
    found |= {"grown MB": grown / 1e6, "memory MB": memory / 1e6}
    visitor.close()
    server.close()
    benchmark.extra_info.update(found)
    print("\n", *(f"{name} {value:.4g};" for name, value in found.items()))
    assert found["answers a second"] > 0.97 * RATE
    assert found["frames a second"] > 0.9 * RATE
    assert grown < 4e6
