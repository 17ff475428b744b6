"""Processes that work on request. Each one is connected by two pipes, so no port is opened."""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from queue import SimpleQueue
from typing import IO, Any, cast

PROGRAM = (
    "import pickle, sys; sys.path[:] = pickle.load(sys.stdin.buffer); "
    "from kinseek.support.workers import serve; serve()"
)
"""Program of such a process. It first receives the search path of this process, so it imports the same kinseek. It does not
import the user's script, which therefore needs no ``if __name__ == "__main__"``.
"""

MEMORY = {"MALLOC_TRIM_THRESHOLD_": str(64 << 20), "MALLOC_MMAP_THRESHOLD_": str(32 << 20)}
"""Environment variables of such a process. Without them the C library returns memory after each array, and the system must
clear it for the next one.
"""

_FLAGS = {"isolated": "-I", "ignore_environment": "-E", "no_user_site": "-s", "no_site": "-S"}
"""Options of Python that limit where it finds code. Such a process has those of this one."""

READY = b"kinseek works\n"
"""First output of such a process. Any earlier output may come from the start of Python."""


class WorkerDied(Exception):
    """A process ended before it had answered; the message says when, as "at block 3"."""


class Worker:
    """A process that works on request. It ends when the process that started it does, even by ``kill -9``."""

    def __init__(self, environment: Mapping[str, str] | None = None) -> None:
        """Start the process; it imports kinseek meanwhile.

        Args:
            environment: Variables of its environment, in addition to those of this process.

        Raises:
            WorkerDied: The system starts no more processes.
        """
        # A frozen program would start itself once more.
        if getattr(sys, "frozen", False) or not sys.executable:
            raise WorkerDied(f"before it started: {sys.executable!r} is not a Python")
        flags = [option for name, option in _FLAGS.items() if getattr(sys.flags, name)]
        # It receives the search path. PYTHONPATH may have relative or empty entries: the working folder of now, from which
        # it would import even what `PROGRAM` names before the path.
        variables = MEMORY | os.environ | dict(environment or {})
        variables.pop("PYTHONPATH", None)
        try:
            self._process = subprocess.Popen(
                [sys.executable, *flags, "-P", "-c", PROGRAM],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env=variables,
                # Ctrl-C in a terminal goes to all processes of its session; this process alone handles it.
                start_new_session=True,
                creationflags=getattr(subprocess, "CREATE_NEW_PROCESS_GROUP", 0),
            )
        except OSError as error:
            raise WorkerDied(f"before it started: {error}") from error
        self._stdin, self._stdout = (
            cast("IO[bytes]", self._process.stdin),
            cast("IO[bytes]", self._process.stdout),
        )

    def __enter__(self) -> Worker:
        """End the process at the end of the block."""
        return self

    def __exit__(self, *raised: object) -> None:
        """End the process."""
        self.close()

    def close(self) -> None:
        """End the process, and wait for its end."""
        self.kill()
        self._process.wait()
        for pipe in (self._stdin, self._stdout):
            with suppress(OSError):  # A pipe may hold bytes for the process that has ended.
                pipe.close()

    def kill(self) -> None:
        """End the process; any thread may call this."""
        self._process.kill()

    def begin(self, work: Callable[[Any], Any] | None = None) -> None:
        """Wait until the process has imported kinseek, and send it a function; None measures the start alone.

        Raises:
            WorkerDied: It ended.
        """
        when = "while it imported kinseek, see what it printed"
        self._send(sys.path, when)
        # The start of Python may print other lines first, even without a line break before this one.
        if not any(line.endswith(READY) for line in self._stdout):
            raise WorkerDied(when)
        self._send(work, when)

    def compute(self, request: Any, when: str) -> Any:
        """Return what the function returns for a request, or raise what it raises.

        Raises:
            WorkerDied: The process ended; the message is `when`.
        """
        self._send(request, when)
        try:
            values, error = pickle.load(self._stdout)
        except (OSError, EOFError, pickle.UnpicklingError) as error:
            raise WorkerDied(when) from error
        if error is not None:
            raise error
        return values

    def _send(self, value: Any, when: str) -> None:
        try:
            pickle.dump(value, self._stdin)
            self._stdin.flush()
        except OSError as error:
            raise WorkerDied(when) from error


def serve() -> None:
    """Work on the requests of `Worker`: the main function of the process."""
    # Opened first: if standard error is closed, this takes its number. Otherwise the results would, and then mix with it.
    silence = os.open(os.devnull, os.O_WRONLY)
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(silence, 1)  # Printed text must not mix with the results.

    requests = SimpleQueue[Any]()

    def read() -> None:
        """Read requests until the other process has ended; then this one ends in the middle of its work."""
        try:
            while True:
                requests.put(pickle.load(sys.stdin.buffer))
        finally:
            # sys.exit would end this thread alone.
            os._exit(1)

    with suppress(EOFError, OSError, MemoryError):  # As in `read`; and a result may be too large to be sent.
        os.write(replies.fileno(), READY)  # At its end Python would try again to write what a buffer holds.
        work: Callable[[Any], Any] = pickle.load(sys.stdin.buffer)
        threading.Thread(target=read, daemon=True).start()
        while True:
            request = requests.get()
            try:
                reply: Any = work(request), None
            except Exception as error:
                reply = None, error
            pickle.dump(reply, replies)
            replies.flush()


@cache
def limit_process(memory: int, seconds: int) -> None:
    """Let the system end this process at its limits, in silence; Windows has no such limits.

    Args:
        memory: Most memory [bytes].
        seconds: Most processor time [s].
    """
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    try:
        import resource
    except ImportError:
        return
    limits = {resource.RLIMIT_DATA: memory, resource.RLIMIT_CPU: seconds, resource.RLIMIT_CORE: 0}
    for kind, most in limits.items():
        _, hard = resource.getrlimit(kind)
        least = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(kind, (least, least))
