"""Output is written at one place: at the end, as a whole, where a closed pipe or a full disk is handled."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import warnings
from collections.abc import Iterator
from typing import Any

from click.exceptions import Exit

from kinseek.errors import LimitWarning, UnitWarning
from kinseek.printable import printable
from kinseek.support.notices import notice

CANNOT_WRITE, BROKEN_PIPE = 2, 141
"""Exit codes; 141 is what a shell reports for a program that was ended by a closed pipe (128 + SIGPIPE)."""


class _Buffer(io.StringIO):
    """A buffer for printed text, with the properties of the stream that it will be written to."""

    def __init__(self, stream: Any) -> None:
        super().__init__()
        self.stream = stream

    def isatty(self) -> bool:
        """Is the stream a terminal?"""
        return self.stream is not None and bool(self.stream.isatty())

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """The encoding of the stream."""
        return getattr(self.stream, "encoding", None) or "utf-8"


@contextlib.contextmanager
def buffered_output() -> Iterator[io.StringIO]:
    """Buffer what is printed."""
    buffer = _Buffer(sys.stdout)
    with contextlib.redirect_stdout(buffer):
        yield buffer


@contextlib.contextmanager
def direct_output() -> Iterator[None]:
    """Print without buffering, for results that somebody waits for.

    Raises:
        Exit: The output cannot be written; the error has been reported.
    """
    stream = getattr(sys.stdout, "stream", sys.stdout)
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="backslashreplace")  # No letter may stop it.
    try:
        with contextlib.redirect_stdout(stream):
            yield
    except OSError as error:
        if error.filename is not None:  # Not of a stream.
            raise
        raise Exit(_not_written(stream, error)) from None


def write_out(text: str, code: int) -> int:
    """Write to stdout; return `code`, or another exit code if writing fails."""
    if not text:
        return code
    stream = sys.stdout
    try:
        if stream is None:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        encoding = getattr(stream, "encoding", None) or "utf-8"
        text = printable(text, "\n\t")  # Names are escaped earlier, all else here.
        stream.write(text.encode(encoding, "backslashreplace").decode(encoding))  # No letter may stop it.
        stream.flush()
    except OSError as error:
        return _not_written(stream, error)
    return code


def _not_written(stream: Any, error: OSError) -> int:
    """Report that a stream accepts no output; return the exit code."""
    forget(stream)
    if isinstance(error, BrokenPipeError):
        return BROKEN_PIPE
    complain(f"cannot write the output: {error.strerror or error}")
    return CANNOT_WRITE


def complain(message: str) -> None:
    """Print a one-line message on stderr, if there is one."""
    notice(" ".join(message.split()))


def on_terminal() -> bool:
    """Return whether stderr is a terminal."""
    return sys.stderr is not None and sys.stderr.isatty()


@contextlib.contextmanager
def warnings_in_one_line() -> Iterator[None]:
    """Print each warning of a unit or a limit in one line, without the line of kinseek's code that raised it."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def show_one(message: Any, category: type[Warning], *where: Any, **rest: Any) -> None:
            if issubclass(category, UnitWarning | LimitWarning):
                complain(f"warning: {message}")
            else:
                show(message, category, *where, **rest)

        warnings.showwarning = show_one
        warnings.simplefilter("always", UnitWarning)
        warnings.simplefilter("always", LimitWarning)
        yield


def forget(stream: Any) -> None:
    """Redirect a broken stream to the null device; otherwise Python would try to write to it again at exit."""
    with contextlib.suppress(OSError, ValueError, AttributeError):
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, stream.fileno())
        os.close(nowhere)
