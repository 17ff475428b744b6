"""Local processes that compute blocks. Each one is connected by two pipes, so no port is opened."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import SimpleQueue
from typing import IO, Any, cast

from kinseek.support.interrupts import SignalSafeThread, next_item

from .block import Index, Work, do

PROGRAM = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from kinseek.maps.processes import serve; serve()"
)
"""Program of such a process. It first receives the search path of this process, so it imports the same kinseek. It does not
import the user's script, which therefore needs no ``if __name__ == "__main__"``.
"""

MEMORY = {"MALLOC_TRIM_THRESHOLD_": str(64 << 20), "MALLOC_MMAP_THRESHOLD_": str(32 << 20)}
"""Environment variables of such a process. Without them the C library returns memory after each array, and the system must
clear it for the next one.
"""

READY = b"kinseek computes blocks\n"
"""First output of such a process. Any earlier output may come from the start of Python."""

ATTEMPTS = 3
"""Number of processes that may end in a row before the map is interrupted."""


class WorkerDied(Exception):
    """A process ended before it had computed its block."""


class Worker:
    """A process that computes blocks. It ends when the process that started it does, even by ``kill -9``."""

    def __init__(self) -> None:
        """Start the process; it imports kinseek meanwhile.

        Raises:
            WorkerDied: The system starts no more processes.
        """
        try:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=MEMORY | os.environ,
                # Ctrl-C in a terminal goes to all processes of its session; this process alone handles it.
                start_new_session=True,
                creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )
        except OSError as error:
            raise WorkerDied(f"a process cannot be started: {error}") from error
        self._stdin, self._stdout = (
            cast("IO[bytes]", self._process.stdin),
            cast("IO[bytes]", self._process.stdout),
        )

    def __enter__(self) -> Worker:
        """End the process at the end of the block."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End the process, and wait for its end."""
        self.kill()
        self._process.wait()
        for pipe in (self._stdin, self._stdout):
            with suppress(OSError):  # A pipe may hold bytes for the process that has ended.
                pipe.close()

    def kill(self) -> None:
        """End the process; any thread may call this."""
        self._process.kill()

    def begin(self, work: Work | None = None) -> None:
        """Wait until the process has imported kinseek, and send it the work; None measures the start alone.

        Raises:
            WorkerDied: It ended.
        """
        when = "while it imported kinseek, see what it printed"
        self._send(sys.path, when)
        # The start of Python may print other lines first, even without a line break before this one.
        if not any(line.endswith(READY) for line in self._stdout):
            raise WorkerDied(_ended(when))
        self._send(work, when)

    def compute(self, index: Index) -> Any:
        """Compute a block; the result is as that of `do`, and so are the errors.

        Raises:
            WorkerDied: It ended.
        """
        when = f"at block {index}, perhaps because memory ran out"
        self._send(index, when)
        try:
            values, error = pickle.load(self._stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            raise WorkerDied(_ended(when)) from error
        if error is not None:
            raise error
        return values

    def _send(self, value: Any, when: str) -> None:
        try:
            pickle.dump(value, self._stdin)
            self._stdin.flush()
        except OSError as error:
            raise WorkerDied(_ended(when)) from error


def _ended(when: str) -> str:
    return f"{ATTEMPTS} processes ended in turn, the last {when}"


def compute_all(work: Work, todo: Sequence[Index], done: Callable[[Index, Any], object]) -> None:
    """Compute blocks, in a process for each core.

    Args:
        work: The work that the blocks belong to.
        todo: Their indices.
        done: Called in this thread with the index of each computed block and the result of `do`.

    Raises:
        WorkerDied: Several processes ended in a row.
        OSError: A block cannot be written.
        InvalidMap: As `do`.
    """
    left, results, stopped = deque(todo), SimpleQueue[tuple[Index, Any] | BaseException](), threading.Event()
    started = list[Worker]()

    def next_block() -> Index | None:
        try:
            return left.popleft()
        except IndexError:
            return None

    def drain() -> None:
        try:
            index, deaths = next_block(), 0
            while index is not None and not stopped.is_set():
                try:
                    with Worker() as worker:
                        started.append(worker)
                        worker.begin(work)
                        while index is not None and not stopped.is_set():
                            results.put((index, worker.compute(index)))
                            index, deaths = next_block(), 0
                # The block is computed again by a new process: the old one may have ended for a reason outside of it.
                except WorkerDied:
                    deaths += 1
                    if deaths == ATTEMPTS:
                        raise
        except BaseException as error:
            results.put(error)

    crew = [SignalSafeThread(drain) for _ in range(min(os.cpu_count() or 1, len(todo)))]
    try:
        for each in crew:
            each.begin()
        for _ in todo:
            result = next_item(results)
            if isinstance(result, BaseException):
                raise result
            done(*result)
    finally:
        stopped.set()
        # The threads wait for results; they end when the pipes of the processes do.
        for worker in list(started):
            worker.kill()
        for each in crew:
            each.wait()


def serve() -> None:
    """Compute blocks on the requests of `Worker`: the main function of the process."""
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # Printed text must not mix with the results.

    blocks = SimpleQueue[Index]()

    def read() -> None:
        """Read requests until the other process has ended; then this one ends in the middle of its block."""
        try:
            while True:
                blocks.put(pickle.load(sys.stdin.buffer))
        finally:
            # sys.exit would end this thread alone.
            os._exit(1)

    with suppress(EOFError, OSError):  # As in `read`.
        os.write(replies.fileno(), READY)  # At its end Python would try again to write what a buffer holds.
        work: Work = pickle.load(sys.stdin.buffer)
        threading.Thread(target=read, daemon=True).start()
        while True:
            index = blocks.get()
            try:
                reply: Any = do(work, index), None
            except Exception as error:
                reply = None, error
            pickle.dump(reply, replies)
            replies.flush()
