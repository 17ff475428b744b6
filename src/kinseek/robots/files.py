"""How files are read: regular ones of a sane size, and no more links and joints than an arm can have.

A description of a robot comes from anywhere. A pipe that nobody writes to, a device or a disk image by the name of a
robot would hang the reader or fill the memory; each is refused instead, and the message says what the limit is.
"""

from __future__ import annotations

import os
import stat
from pathlib import Path

from kinseek.errors import InvalidRobot, suggest

MOST_BYTES = 32 * 2**20
"""Bytes of a file, and of all files that it includes together: a hundred times the largest robot known to us."""
MOST_LINKS = 10_000
"""Links, and joints, of one file."""
MOST_JOINTS = 1_000
"""Moving joints between base and tip."""

_NOT_A_FILE = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def file_bytes(path: Path, most: int = MOST_BYTES) -> bytes:
    """Read a whole file.

    Args:
        path: The file.
        most: Bytes that it may hold.

    Raises:
        InvalidRobot: There is no such file, it is no regular file, it cannot be read, or it is too large.
    """
    try:
        if what := instead_of_a_file(path):
            raise InvalidRobot(f"cannot read {str(path)!r}: it is {what}, expected a regular file")
        with path.open("rb") as file:
            text = file.read(most + 1)  # Files of the kernel say that they are empty, and never end.
    except InvalidRobot:
        raise
    except FileNotFoundError:
        raise InvalidRobot(f"no file {str(path)!r}{_hint(path)}") from None
    except OSError as error:
        raise InvalidRobot(f"cannot read {str(path)!r}: {error.strerror}") from error
    except ValueError as error:  # A zero byte in the name.
        raise InvalidRobot(f"no file can be called {str(path)!r}: {error}") from None
    if len(text) > most:
        size = os.path.getsize(path)
        raise InvalidRobot(
            f"{str(path)!r} holds {f'{size:,}' if size > most else 'too many'} bytes, expected at most {most:,}: "
            "a description of a robot is smaller"
        )
    return text


def instead_of_a_file(path: Path) -> str:
    """What is there instead of a regular file, such as ``"a pipe"``; empty if it is one.

    Raises:
        OSError: There is nothing, or it cannot be looked at.
    """
    mode = path.stat().st_mode
    if stat.S_ISREG(mode):
        return ""
    return next((name for test, name in _NOT_A_FILE if test(mode)), "something else")


def require_few(count: int, noun: str, most: int, where: str) -> None:
    """Refuse more of something than a reader takes.

    Raises:
        InvalidRobot: There are more than `most`.
    """
    if count > most:
        raise InvalidRobot(f"{where}: {count:,} {noun}, expected at most {most:,}")


def _hint(path: Path) -> str:
    try:
        nearby = [p.name for p in path.parent.glob("*") if p.suffix in {".urdf", ".xacro", ".xml"}]
    except OSError:
        return ""
    return f" ({suggest(path.name, nearby, 'file')})" if nearby else ""
