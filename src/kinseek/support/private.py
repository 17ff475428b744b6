"""Folders and files that no other user can change, so that code read from them may be run.

On systems without user ids (Windows) access lists protect a user's folders. They are not checked here; only links are
rejected.
"""

from __future__ import annotations

import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

MOST_LINKS = 40
"""Maximum number of links in one path, the limit of Linux."""


OTHERS_WRITE = stat.S_IWGRP | stat.S_IWOTH
"""Permissions of a folder or file that others may change."""


READ_NO_LINK = os.O_RDONLY | sum(
    getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY")
)
"""Flags that open a file to read it, but no link, and that do not wait for a pipe."""


class NotPrivate(OSError):
    """Another user may have made, or may change, a folder or file."""


def user_cache() -> str:
    """Return the user's cache folder: `XDG_CACHE_HOME`, else `LOCALAPPDATA`, else ``~/.cache``.

    A relative path is ignored, as the XDG Base Directory Specification requires.
    """
    named = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or ""
    return named if os.path.isabs(os.path.expanduser(named)) else "~/.cache"


def private_folder(base: Path, *names: str) -> Path:
    """Return a folder that no other user can change or replace; missing folders are made, for this user alone.

    Every folder on the way must belong to this user or to root and not be writable by others. Folders like ``/tmp``, where
    nobody can replace the files of others, are accepted, too. Links on the way are followed once.

    Args:
        base: A folder of the user's choice; its path may contain links.
        names: Nested folders below it that kinseek makes: they belong to this user and are not links.

    Returns:
        Its path without links. If links change later, this path still leads to the same folder.

    Raises:
        NotPrivate: Another user can change it, or the base is a relative path, into a working folder that may have come from
            anybody. The message names the folder and the reason.
        OSError: It cannot be made.
    """
    if not base.is_absolute():
        raise NotPrivate(f"{base} is in the working folder, expected an absolute path")
    at = _followed(base)
    for name in names:
        at /= name
        status = _made(at)
        if stat.S_ISLNK(status.st_mode):
            raise NotPrivate(f"{at} is a link")
        require_private(at, status)
    return at


def read_private(path: Path) -> bytes:
    """Read a file of this user that no other user can write to.

    Raises:
        NotPrivate: It is a link, belongs to another user, or others may write to it.
        OSError: It cannot be read, or is not a regular file.
    """
    try:
        descriptor = os.open(path, READ_NO_LINK)
    except OSError:
        if path.is_symlink():
            raise NotPrivate(f"{path} is a link") from None
        raise
    try:
        # The open file is checked, not its name, which may refer to another file by now.
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(f"{path} is not a regular file")
        require_private(path, status)
        with open(descriptor, "rb", closefd=False) as file:
            return file.read()
    finally:
        os.close(descriptor)


def make_folders(base: Path, below: Path) -> None:
    """Make the folders of a path below a base, with write permission for this user only, whatever the umask is.

    They never need another mode: to change it later by name would change that of whatever has the name by then.
    """
    for part in below.parts:
        base /= part
        if not base.is_dir():
            with suppress(FileExistsError):
                base.mkdir(mode=0o777 & ~OTHERS_WRITE)


def require_private(path: Path, status: os.stat_result) -> None:
    """Check that a folder or file belongs to this user, and that nobody else may write to it.

    Raises:
        NotPrivate: The check failed; the message names the file and the reason.
    """
    if not hasattr(os, "geteuid"):
        return
    if status.st_uid != os.geteuid():
        raise NotPrivate(f"{path} belongs to user {status.st_uid}")
    if status.st_mode & OTHERS_WRITE:
        raise NotPrivate(f"others may write to {path} (mode {stat.S_IMODE(status.st_mode):o})")


def resolved(path: Path) -> Path:
    """Return a path without links, as `Path.resolve` does; what it leads to may be missing.

    Raises:
        NotPrivate: A link leads to itself, or is in a folder that several users may write to, such as ``/tmp``, and another
            user has put it there. In ``/tmp`` Linux does not follow such links either (``fs.protected_symlinks``), but
            `Path.resolve` reads them itself.
        OSError: A folder cannot be searched.
        ValueError: The path has a null character.
    """
    if not hasattr(os, "geteuid"):
        return path.resolve()

    def look(entry: Path) -> os.stat_result | None:
        try:
            status = entry.lstat()
        except (FileNotFoundError, NotADirectoryError):
            return None
        around = entry.parent.stat()
        shared = around.st_mode & OTHERS_WRITE
        if stat.S_ISLNK(status.st_mode) and shared and status.st_uid not in (0, os.geteuid(), around.st_uid):
            raise NotPrivate(f"{entry} is a link of user {status.st_uid} in a folder of several users")
        return status

    return _walked(path.absolute(), look)


def _followed(path: Path) -> Path:
    """Resolve the links of an absolute path, and check and make each folder on the way."""

    def look(entry: Path) -> os.stat_result:
        status = _made(entry)
        _require_safe(entry, status)
        return status

    anchor = Path(path.anchor)
    _require_safe(anchor, anchor.lstat())
    return _walked(path, look)


def _walked(path: Path, look: Callable[[Path], os.stat_result | None]) -> Path:
    """Resolve the links of an absolute path step by step.

    Args:
        path: The path.
        look: Returns the status of each file, folder or link on the way; None where nothing is.

    Raises:
        NotPrivate: There are too many links, such as one that leads to itself; or what `look` raises.
    """
    at, names, links = Path(path.anchor), list(reversed(path.parts[1:])), 0
    while names:
        name = names.pop()
        if name == "..":
            at = at.parent
            continue
        entry = at / name
        status = look(entry)
        if status is None or not stat.S_ISLNK(status.st_mode):
            at = entry
            continue
        links += 1
        if links > MOST_LINKS:
            raise NotPrivate(f"{path} leads through more than {MOST_LINKS} links")
        target = entry.readlink()
        if target.is_absolute():
            at = Path(target.anchor)
        names.extend(reversed(target.parts[1:] if target.is_absolute() else target.parts))
    return at


def _made(folder: Path) -> os.stat_result:
    """Make a folder if nothing of its name exists, and return the status of what exists; links are not followed.

    Raises:
        NotADirectoryError: Something other than a folder or a link exists there.
    """
    try:
        status = folder.lstat()
    except FileNotFoundError:
        with suppress(FileExistsError):  # Another process was faster.
            folder.mkdir(mode=0o700)
        status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) and not stat.S_ISLNK(status.st_mode):
        raise NotADirectoryError(f"{folder} is not a folder")
    return status


def _require_safe(path: Path, status: os.stat_result) -> None:
    """Check a folder on the way, or a link: only this user and root may replace the files of others in it."""
    if not hasattr(os, "geteuid"):
        return
    if status.st_uid not in (0, os.geteuid()):
        raise NotPrivate(f"{path} belongs to user {status.st_uid}")
    shared = not stat.S_ISLNK(status.st_mode) and status.st_mode & OTHERS_WRITE
    if shared and not (status.st_uid == 0 and status.st_mode & stat.S_ISVTX):
        raise NotPrivate(f"others may write to {path} (mode {stat.S_IMODE(status.st_mode):o})")
