"""Ten minutes of every call, and of forks, pickles and copies beside a thread: ``python -m tests.soak [SECONDS]``.

Calls go on in turns, with new poses each time. A line with the memory of the process is printed each half a minute; the end
compares the median of the last third with that of the second: more than `MOST` is a failure. On Linux, where that memory
can be read.
"""

from __future__ import annotations

import copy
import gc
import importlib
import os
import pickle
import signal
import sys
import threading
import time
import warnings
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


def beside(arm: Any, poses: Any) -> None:
    """Fork, pickle and copy while another thread makes a call."""
    thread = threading.Thread(target=verbs.VERBS["ik, a batch"], args=(arm, poses))
    thread.start()
    pid = os.fork()
    if pid == 0:
        signal.alarm(60)
        verbs.VERBS["branches"](arm, poses)
        os._exit(0)
    for again in (pickle.loads(pickle.dumps(arm)), copy.deepcopy(arm)):
        again.ik(poses, threads=1)
    thread.join()
    if status := os.waitpid(pid, 0)[1]:
        raise RuntimeError(f"a forked child ended with status {status}")


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
            beside(arm, poses)
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
    warnings.simplefilter("ignore", DeprecationWarning)  # Python 3.12 warns of every fork beside threads.
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 600.0
    held = soak(seconds)
    more = growth(held)
    calls = len(verbs.VERBS) * len(verbs.ARMS)
    print(f"{len(held)} turns of {calls} calls; {held[-1]:.2f} MiB, grown by {more:+.2f} (at most {MOST})")
    return int(more > MOST)


if __name__ == "__main__":
    sys.exit(main())
