"""Read only regular files of limited size, with limited numbers of links and joints.

A robot description may come from anywhere. A pipe without a writer, a device or a disk image with the name of a robot would
block the reader or fill the memory. Each is rejected, and the message contains the limit.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Iterable
from functools import partial
from itertools import islice
from pathlib import Path, PureWindowsPath

from kinseek.errors import InvalidRobot, near_names
from kinseek.printable import printable

MOST_BYTES = 32 * 2**20
"""Most bytes of a file together with all files it includes: a hundred times the largest known robot."""
MOST_LINKS = 10_000
"""Most links, and most joints, of one file."""
MOST_JOINTS = 1_000
"""Most moving joints between base and tip."""
MOST_NAME = 1_000
"""Most letters of the name of a robot, link, joint or obstacle: a table has the width of the longest name in every row."""

ENDINGS = (".urdf", ".xacro", ".xml")
"""Endings of files that describe an arm."""
ANY_ENDING = f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
"""The endings, for messages."""

WINDOWS = os.name == "nt"
"""Whether a name such as ``//server/share/file`` makes the system connect to another machine."""

_SEARCHED, _LISTED = 500, 20
"""Number of files among which a message looks for those that may be meant, and number of those that it lists. A robot may
name thousands of files that are not there."""

_NOT_A_FILE = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def home_path(path: str | os.PathLike[str]) -> Path:
    """Return a path with ``~`` and ``~user`` replaced; where there is no such user or home folder, the path as it is.

    `Path.expanduser` raises a RuntimeError there.
    """
    return Path(os.path.expanduser(path))


def without_links(path: Path) -> Path:
    """Return the path to which links lead; the path as it is if it leads nowhere, or another program replaces a link."""
    try:
        return path.resolve()
    except (OSError, RuntimeError):
        return path


def file_bytes(path: Path, most: int = MOST_BYTES, *, below: Path | None = None, hints: bool = True) -> bytes:
    """Read a whole file.

    Args:
        path: The file.
        most: Largest allowed size in bytes.
        below: A folder above a path without links, from which no link may lead; None permits links.
        hints: If the file does not exist, name files in its folder that may be meant? This may take a fifth of a second.

    Raises:
        InvalidRobot: The file does not exist, is not a regular file, cannot be read, or is too large.
    """
    try:
        _require_regular(instead_of_a_file(path), path)
        # Its owner may put a pipe in its place at any moment: it is opened without waiting, and checked again.
        opener = _open_at_once if below is None else partial(_open_below, below)
        with open(path, "rb", opener=opener) as file:
            _require_regular(_instead(os.fstat(file.fileno())), path)
            # Files of the kernel report size 0, and some never end; one without new data gives None.
            text = file.read(most + 1) or b""
    except InvalidRobot:
        raise
    except FileNotFoundError:
        raise InvalidRobot(f"no file {str(path)!r}{_hint(path) if hints else ''}") from None
    except OSError as error:
        raise InvalidRobot(f"cannot read {str(path)!r}: {error.strerror}") from error
    except ValueError as error:  # The name contains a zero byte.
        raise InvalidRobot(f"{str(path)!r} is not a valid file name: {error}") from None
    if len(text) > most:
        size = os.path.getsize(path)
        raise InvalidRobot(
            f"{str(path)!r} holds {f'{size:,}' if size > most else 'too many'} bytes, expected at most {most:,}: "
            "a description of a robot is smaller"
        )
    return text


def require_here(name: str, robot: Path, folders: Iterable[str | Path] = ()) -> None:
    r"""Check that a name in a robot's file does not make Windows connect to another machine, which would learn who asks.

    Args:
        name: The name, which may begin like ``\\server\share``.
        robot: The robot's file; it may lie on a share itself, whose other files may be named then.
        folders: Folders that the user named, as `robot`.

    Raises:
        InvalidRobot: It names another machine, or a device by its path.
    """
    if not WINDOWS or len(name) < 2 or not set(name[:2]) <= set("/\\"):
        return
    # The resolved path of a file on a drive that is a share begins with the name of the share.
    known = {
        PureWindowsPath(each).drive.lower() for each in (robot.absolute(), without_links(robot), *folders)
    }
    if PureWindowsPath(name).drive.lower() not in known - {""}:
        raise InvalidRobot(
            f"{name!r} is a file of another machine, expected one of this machine or of the share that holds the robot's "
            "file; connect the share with a drive letter"
        )


def instead_of_a_file(path: Path) -> str:
    """Describe what the path is instead of a regular file, such as ``"a pipe"``; empty for a regular file.

    Raises:
        OSError: The path does not exist or cannot be examined.
    """
    return _instead(path.stat())


def _instead(status: os.stat_result) -> str:
    if stat.S_ISREG(status.st_mode):
        return ""
    return next((name for test, name in _NOT_A_FILE if test(status.st_mode)), "something else")


def _require_regular(what: str, path: Path) -> None:
    if what:
        raise InvalidRobot(f"cannot read {str(path)!r}: it is {what}, expected a regular file")


def _open_at_once(path: str, flags: int) -> int:
    """Open without waiting for the other end of a pipe."""
    return os.open(path, flags | getattr(os, "O_NONBLOCK", 0))


def _open_below(folder: Path, path: str, flags: int) -> int:
    """Open a file below a folder, step by step: another user may have put links in its path since it was resolved."""
    if os.open not in os.supports_dir_fd:  # Windows.
        return _open_at_once(path, flags)
    *names, last = Path(path).relative_to(folder).parts
    at = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for name in names:
            inner = os.open(name, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW, dir_fd=at)
            os.close(at)
            at = inner
        return os.open(last, flags | os.O_NONBLOCK | os.O_NOFOLLOW, dir_fd=at)
    finally:
        os.close(at)


def require_few(count: int, noun: str, most: int, where: str) -> None:
    """Reject more of something than a reader takes.

    Raises:
        InvalidRobot: There are more than `most`.
    """
    if count > most:
        raise InvalidRobot(f"{where}: {count:,} {noun}, expected at most {most:,}")


def instead_of_a_description(path: Path) -> str:
    """Describe an existing folder or file that is not the description of an arm; empty if there is none."""
    try:
        if home_path(path).is_dir():
            return "a folder"
        return f"a file that ends in {path.suffix!r}" if path.suffix and path.is_file() else ""
    except (OSError, ValueError):  # The name is too long for a file, or contains a zero byte.
        return ""


def _hint(path: Path) -> str:
    """Return the similar names of files in the same folder that could be meant, and the list of them."""
    kinds = ENDINGS if path.suffix in ENDINGS else (path.suffix,)
    try:
        some = [p.name for p in islice(path.parent.glob("*"), _SEARCHED) if p.suffix in kinds]
    except OSError:
        return ""
    nearby = sorted(set(some) - {path.name})
    if not nearby:
        return ""
    near = near_names(path.name, nearby)
    meant = f"; did you mean {' or '.join(map(repr, near))}?" if near else "."
    listed, more = map(printable, nearby[:_LISTED]), len(nearby) - _LISTED
    return f"{meant} In its folder: {', '.join(listed)}" + (f" and {more} more" if more > 0 else "")
