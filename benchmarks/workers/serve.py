"""The program of every worker: calls functions of one module, as lines of JSON ask for them.

    python -m benchmarks.workers.serve MODULE

Imports NumPy and that module, in whatever environment it runs. Arrays travel as lists.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
from typing import Any


class Refused(Exception):
    """A call cannot be made here; the message is complete without the name of the exception."""


def limit_memory(gigabytes: int) -> None:
    """Bound the memory of this process, so that a solver that runs away does not take the machine with it."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (gigabytes << 30, gigabytes << 30))


def in_words(error: Exception) -> str:
    """An exception in one line."""
    if isinstance(error, Refused):
        return str(error)
    return f"{type(error).__name__}: {error}".splitlines()[0][:120]


def as_list(value: Any) -> Any:
    """What JSON cannot write: arrays and numbers of NumPy."""
    return value.tolist()


def main() -> None:
    """Answer until there are no more lines."""
    limit_memory(12)
    # What a solver prints goes to the log; the caller reads replies alone.
    replies = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    module = importlib.import_module(sys.argv[1])
    for line in sys.stdin:
        request = json.loads(line)
        try:
            reply = {"value": getattr(module, request["call"])(**request["arguments"])}
        except Exception as error:
            reply = {"raised": in_words(error)}
        replies.write(json.dumps(reply, default=as_list) + "\n")
        replies.flush()


if __name__ == "__main__":
    # Modules import `Refused` from here: run the module of that name, not a second copy of it.
    from benchmarks.workers.serve import main as serve

    serve()
