"""Ten minutes of every call, with the memory of the process over time: ``python -m tests.soak [SECONDS]``.

Calls go on in turns, with new poses each time. A line is printed each half a minute; the end compares the median of the last
third with that of the second: more than `MOST` is a failure. On Linux, where the process's memory can be read.
"""

from __future__ import annotations

import gc
import importlib
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
verbs: Any = importlib.import_module("verbs")

MOST = 2.0
"""Growth from the second third to the last [MiB]."""
EVERY = 30.0
"""[s] between two lines."""


def resident() -> float:
    """Memory that this process holds [MiB]."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 2**20


def soak(seconds: float, told: Any = print, every: float = EVERY) -> list[float]:
    """Make every call in turns; the memory after each turn [MiB]."""
    begin = time.monotonic()
    held, turn, line = [], 0, begin
    while time.monotonic() - begin < seconds or turn < 3:
        for name in verbs.ARMS:
            arm = verbs.arm_of(name)
            poses = verbs.asked(arm, seed=turn)
            for call in verbs.VERBS.values():
                call(arm, poses)
        gc.collect()
        held.append(resident())
        turn += 1
        if time.monotonic() - line >= every:
            line = time.monotonic()
            told(f"{line - begin:6.0f} s  {turn:6d} turns  {held[-1]:8.2f} MiB")
    return held


def growth(held: list[float]) -> float:
    """From the second third of the turns to the last, medians [MiB]."""
    third = max(len(held) // 3, 1)
    return float(np.median(held[-third:]) - np.median(held[third : 2 * third]))


def main() -> int:
    """Run as long as is asked for."""
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    held = soak(seconds)
    more = growth(held)
    calls = len(verbs.VERBS) * len(verbs.ARMS)
    print(f"{len(held)} turns of {calls} calls; {held[-1]:.2f} MiB, grown by {more:+.2f} (at most {MOST})")
    return int(more > MOST)


if __name__ == "__main__":
    sys.exit(main())
