"""How long calls take: one by one from Python, as batches on one thread, and in processor time; and their memory."""

from __future__ import annotations

import statistics
import time
import tracemalloc
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray


def timed(ask: Callable[[Any], Any], targets: Iterable[Any]) -> tuple[list[Any], NDArray[np.float64]]:
    """Ask for each target, one call right after the other; the answers, and the wall time of each call [µs]."""
    answers, times = [], []
    for target in targets:
        began = time.perf_counter_ns()
        answer = ask(target)
        times.append((time.perf_counter_ns() - began) / 1e3)
        answers.append(answer)
    return answers, np.array(times)


def batch_cost(work: Callable[[], Any], count: int, repeats: int = 3) -> float:
    """Time of this thread for one of `count` poses [µs], median of some runs: others on the machine count for little."""
    times = []
    for _ in range(repeats):
        began = time.thread_time_ns()
        work()
        times.append((time.thread_time_ns() - began) / 1e3 / count)
    return statistics.median(times)


def least(work: Callable[[], Any], repeats: int = 3) -> float:
    """Least wall time of some runs [s]."""
    return float(min(timed(lambda _: work(), range(repeats))[1])) / 1e6


def cpu(work: Callable[..., Any], *given: Any) -> tuple[float, Any]:
    """CPU time of this process [s], and what came of it."""
    began = time.process_time()
    result = work(*given)
    return time.process_time() - began, result


def peak(work: Callable[[], object]) -> int:
    """The most memory that Python and NumPy hold during some work [bytes]."""
    tracemalloc.start()
    work()
    held = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return held
