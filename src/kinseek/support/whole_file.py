"""Output files that are written completely, or not at all."""

from __future__ import annotations

import contextlib
import os
import stat
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from kinseek.errors import InvalidProblem

from .private import OTHERS_WRITE, resolved

_MAY_WRITE = stat.S_IWUSR | stat.S_IWGRP | stat.S_IWOTH


def output_path(path: Path, what: str) -> Path:
    """Return the path of an output file, with links resolved.

    Args:
        path: The file, which may exist.
        what: The option or argument that names it, for messages.

    Raises:
        InvalidProblem: A missing folder, a target that is not a regular file or that nobody may write to, or a link that
            another user may have put there.
    """
    try:
        place = resolved(path)
    except (OSError, ValueError) as error:
        raise InvalidProblem(f"{what} {str(path)!r}: {error}") from None
    if not place.parent.is_dir():
        raise InvalidProblem(f"{what} {str(path)!r}: folder {str(place.parent)!r} does not exist")
    if place.exists() and not place.is_file():
        raise InvalidProblem(f"{what} {str(path)!r} is not a regular file")
    if place.exists() and not place.stat().st_mode & _MAY_WRITE:
        raise InvalidProblem(f"{what} {str(path)!r} is write-protected")
    return place


@contextlib.contextmanager
def whole_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file that replaces `path` when it is complete; until then, and after a failure, nothing is changed.

    An existing file keeps its permissions and its group: who may not read it may not read what replaces it either. If this
    user is not in that group, the new group may do what others may. The file does not keep set-user-ID and set-group-ID
    bits, because another user may have made it. If another user has made it, only this user may write to the new one.

    Args:
        path: A path from `output_path`.

    Raises:
        InvalidProblem: It cannot be written.
    """
    # In the same folder, since only a file of the same file system can be replaced in one step.
    # Process ids repeat in containers, and a process that was killed leaves its file.
    part = path.with_name(f".{uuid.uuid4().hex}.part")
    try:
        old = path.stat() if path.exists() else None
        # Nobody opens it in between who may not read it later.
        first = 0o666 if old is None else _kept_mode(old) & ~stat.S_IRWXG
        file = open(part, "xb", opener=lambda name, flags: os.open(name, flags, first))  # noqa: SIM115  # Closed below.
        try:
            with file:
                if old is not None:
                    # Of the open file, because another user may have put a link in its place.
                    opened = file.fileno() if os.chmod in os.supports_fd else part
                    os.chmod(opened, _mode_in_group(file.fileno(), old))
                yield file
            part.replace(path)
        except BaseException:  # Includes Ctrl-C.
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        reason = error.strerror or error
        raise InvalidProblem(f"cannot write {str(path)!r}: {reason}; it was not written") from None


def _mode_in_group(file: int, old: os.stat_result) -> int:
    """Give an open file the group of the one that it replaces, and return its permissions."""
    mode = _kept_mode(old)
    if os.fstat(file).st_gid != old.st_gid:
        try:
            os.fchown(file, -1, old.st_gid)
        except OSError:
            # This user is not in that group. For the old file, members of the new group were others.
            mode = mode & ~stat.S_IRWXG | (mode & stat.S_IRWXO) << 3
    return mode


def _kept_mode(status: os.stat_result) -> int:
    """Return the permissions of a file that it leaves to the one that replaces it."""
    own = not hasattr(os, "geteuid") or status.st_uid == os.geteuid()
    return status.st_mode & (0o777 if own else 0o777 & ~OTHERS_WRITE)
