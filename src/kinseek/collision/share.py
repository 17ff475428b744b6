"""Short work shared by threads: what takes a millisecond shall not wait a tenth of one for helpers.

`solvers.threads.spread` also shows progress, keeps a deadline and hears Ctrl-C while others work; it takes some 60 µs more a
call, which is a quarter of what two threads need for the smallest batch that is shared.
"""

from __future__ import annotations

import _thread
from collections.abc import Callable, Iterable
from queue import SimpleQueue


def share(work: Callable[[int], object], pieces: Iterable[int], threads: int) -> None:
    """Do some work for every piece; this thread takes its share, and waits for the others by calls into C only.

    After Ctrl-C no further piece is begun, and the others are waited for: a piece should take a millisecond or so.

    Args:
        work: Takes a piece; what it raises ends the work, and is raised here.
        pieces: Each is taken by one thread.
        threads: In all.
    """
    left, ended, errors = iter(pieces), SimpleQueue[None](), list[BaseException]()

    def drain() -> None:
        for piece in left:  # Each thread takes the next piece that nobody has.
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
