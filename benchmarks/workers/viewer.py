"""The viewer of one arm, on one core, and its figures; served by `serve` for `benchmarks/test_viewer.py`."""

from __future__ import annotations

import os
import resource
from pathlib import Path
from typing import Any

import kinseek
from kinseek import viewer
from kinseek.viewer.page import Page

ANSWERED = [0]
"""Goals that are answered."""

RUNNING: list[Any] = []


def begin(arm: str) -> int:
    """Show an arm; return the port."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    solve = Page._solve

    def counted(self: Page, asked: tuple[int, Any]) -> None:
        solve(self, asked)
        ANSWERED[0] += 1

    Page._solve = counted  # type: ignore[method-assign]
    RUNNING[:] = [viewer.show(kinseek.load(arm), port=0, block=False, open_browser=False)]
    return int(RUNNING[0].port)


def figures() -> dict[str, Any]:
    """Answered goals, memory [B], CPU time [s], and of the page its goal and whether it is idle, if one is open."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    memory = int(pages) * resource.getpagesize()
    found: dict[str, Any] = {"answered": ANSWERED[0], "memory": memory, "cpu": sum(os.times()[:2])}
    page = next(iter(RUNNING[0].pages.values()), None)
    return found if page is None else found | {"goal": page.options.target.tolist(), "idle": page.idle}
