"""Threads for short work: a call of a millisecond must not wait a tenth of that for other threads.

`solvers.threads.parallel_for` also shows progress, checks a deadline and handles Ctrl-C while others work. It takes some
60 µs more per call, a quarter of the time of two threads for the smallest batch that is shared.
"""

from __future__ import annotations

import _thread
from collections.abc import Callable, Iterable
from queue import SimpleQueue


def share(work: Callable[[int], object], pieces: Iterable[int], threads: int) -> None:
    """Do some work for every piece; the calling thread takes part, and then waits for the others by calls into C only.

    After Ctrl-C no further piece is begun, and the pieces in progress are awaited. A piece should take about a millisecond.

    Args:
        work: Called with a piece; an error that it raises ends the work, and is raised here.
        pieces: Each is processed by one thread.
        threads: Total number of threads.
    """
    left, ended, errors = iter(pieces), SimpleQueue[None](), list[BaseException]()

    def drain() -> None:
        for piece in left:  # Each thread takes the next free piece.
            if errors:
                return
            work(piece)

    def help_out() -> None:
        try:
            drain()
        except BaseException as error:
            errors.append(error)
        finally:
            ended.put(None)

    helpers = 0
    try:
        for _ in range(threads - 1):
            _thread.start_new_thread(help_out, ())
            helpers += 1
        drain()
    except BaseException as error:
        errors.append(error)
        raise
    finally:
        for _ in range(helpers):
            ended.get()
    if errors:
        raise errors[0]
