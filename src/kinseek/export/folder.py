"""Output folder of an export. Only files that kinseek wrote are replaced, and links in the folder are never followed."""

from __future__ import annotations

import errno
import os
import stat
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import NamedTuple

try:
    import fcntl
except ImportError:  # Windows.
    fcntl = None  # type: ignore[assignment]

from kinseek.errors import InvalidExport
from kinseek.support.private import READ_NO_LINK, resolved

_PATIENCE = 10.0
"""How long another export into the same folder is waited for [s]."""


class Owned(NamedTuple):
    """The files of one kind of export."""

    names: frozenset[str]
    """Names of all files that such an export writes, or an earlier one may have written."""
    marked: str
    """The file whose beginning shows that the others are kinseek's."""
    mark: str
    """The beginning of that file."""


def own_folder(folder: str | Path, owned: Owned, named: bool = True) -> Path:
    """Check that an export may be written into a folder.

    Args:
        folder: It may be missing; the folder around it must exist.
        owned: The files of the export.
        named: Has the user named the folder? Then it may be a link, or belong to another user.

    Returns:
        Its path without links.

    Raises:
        InvalidExport: The folder is not a path, cannot be made, or has files of these names that are not kinseek's; or its
            path has a link that another user may have put there.
    """
    if not isinstance(folder, str | Path) or not str(folder):
        raise InvalidExport(f"folder must be a path, got {folder!r}")
    try:
        place = resolved(Path(folder)) if named else Path(folder).absolute()
        exists, fits, around = place.exists(), place.is_dir(), place.parent.is_dir()
        if fits:
            with _opened(place, named) as opened:
                opened.require_ours(owned)
    except InvalidExport:
        raise
    except (OSError, ValueError) as error:
        raise InvalidExport(f"cannot look into {str(folder)!r}: {error}") from error
    if exists and not fits:
        raise InvalidExport(f"{str(folder)!r} is not a folder")
    if not around:
        raise InvalidExport(
            f"folder {str(place.parent)!r}, in which {place.name!r} would be created, does not exist"
        )
    return place


def write_files(folder: str | Path, owned: Owned, files: Mapping[str, bytes], named: bool = True) -> None:
    """Write the files of an export in place of those of an earlier one; make the folder if it is missing.

    Args:
        folder: As in `own_folder`.
        owned: The files of the export.
        files: The content of each file, by its name.
        named: As in `own_folder`.

    Raises:
        InvalidExport: As in `own_folder`, or a file cannot be written.
    """
    place = own_folder(folder, owned, named)
    try:
        with suppress(FileExistsError):
            place.mkdir()
        with _opened(place, named) as opened, _alone(opened):
            opened.require_ours(owned)
            # Whenever this ends, the marked file is there, so that the next export replaces what was written, and no program
            # can be compiled of files of two exports.
            for name in owned.names - {owned.marked}:
                opened.remove(name)
            for name in sorted(files, key=lambda name: name != owned.marked):
                opened.put(name, files[name])
    except OSError as error:
        raise InvalidExport(f"cannot write into {str(place)!r}: {error.strerror or error}") from error


@contextmanager
def _opened(place: Path, named: bool) -> Iterator[_Folder]:
    """Open a folder, so that another user who may rename it cannot put another one in its place meanwhile.

    Raises:
        InvalidExport: It belongs to another user, and this one has not named it.
        OSError: It is not a folder, or cannot be opened.
    """
    if os.open not in os.supports_dir_fd:  # Windows.
        yield _Folder(place, None)
        return
    descriptor = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        if not named and os.fstat(descriptor).st_uid != os.geteuid():
            raise InvalidExport(f"{place.name!r} belongs to another user; name a folder")
        yield _Folder(place, descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _alone(opened: _Folder) -> Iterator[None]:
    """Let another export into the same folder end first, so that the files are those of one.

    Raises:
        InvalidExport: It does not end. Another user who may read the folder can cause that.
    """
    if fcntl is None or opened.descriptor is None:
        yield
        return
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            fcntl.flock(opened.descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            break
        except BlockingIOError:
            if time.monotonic() > end:
                raise InvalidExport(f"another process is writing into {str(opened.place)!r}") from None
            time.sleep(0.01)
        except OSError:  # NFS locks no folder.
            break
    yield


class _Folder(NamedTuple):
    """A folder, with its descriptor where the system has one."""

    place: Path
    descriptor: int | None

    def require_ours(self, owned: Owned) -> None:
        """Check that files of an export are missing, or are kinseek's.

        Raises:
            InvalidExport: They are of somebody else. A link counts as a file, wherever it leads.
        """
        there = owned.names & set(os.listdir(self.place if self.descriptor is None else self.descriptor))
        if there and self._beginning(owned.marked, len(owned.mark)) != owned.mark.encode():
            raise InvalidExport(
                f"{str(self.place)!r} holds {', '.join(sorted(there))}, which kinseek did not write; choose another folder"
            )

    def put(self, name: str, content: bytes) -> None:
        """Write a whole file in place of a file or link of this name."""
        part = f".{uuid.uuid4().hex}.part"
        new = os.open(self._at(part), os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o666, dir_fd=self.descriptor)
        try:
            with open(new, "wb") as file:
                file.write(content)
            os.replace(self._at(part), self._at(name), src_dir_fd=self.descriptor, dst_dir_fd=self.descriptor)
        except BaseException:  # Includes Ctrl-C.
            self.remove(part)
            raise

    def remove(self, name: str) -> None:
        """Remove a file or link if it is there."""
        with suppress(FileNotFoundError):
            os.unlink(self._at(name), dir_fd=self.descriptor)

    def _beginning(self, name: str, count: int) -> bytes:
        """Return the first bytes of a regular file, none of anything else."""
        try:
            descriptor = os.open(self._at(name), READ_NO_LINK, dir_fd=self.descriptor)
        except OSError as error:
            if error.errno in (errno.ENOENT, errno.ELOOP):  # Not there, or a link.
                return b""
            raise
        try:
            return os.read(descriptor, count) if stat.S_ISREG(os.fstat(descriptor).st_mode) else b""
        finally:
            os.close(descriptor)

    def _at(self, name: str) -> str:
        """Return what the functions of `os` take: a name in the open folder, or a path."""
        return name if self.descriptor is not None else str(self.place / name)
