"""Output folder of an export. Only files that kinseek wrote are replaced, and links in the folder are never followed."""

from __future__ import annotations

import os
from collections.abc import Collection, Mapping
from pathlib import Path

from kinseek.errors import InvalidExport


def own_folder(folder: str | Path, names: Collection[str], marked: str, mark: str) -> Path:
    """Check that an export may be written into a folder.

    Args:
        folder: It may be missing; the folder around it must exist. It may be a link, because its name is the user's.
        names: Files that an export writes or removes.
        marked: The file whose beginning shows that the others are kinseek's.
        mark: The beginning of that file.

    Raises:
        InvalidExport: The folder is not a path, cannot be made, or has files of these names that are not kinseek's.
    """
    if not isinstance(folder, str | Path) or not str(folder):
        raise InvalidExport(f"folder must be a path, got {folder!r}")
    place = Path(folder)
    head = place / marked
    try:
        exists, fits, around = place.exists(), place.is_dir(), place.parent.is_dir()
        ours = head.is_file() and _beginning(head, len(mark)) == mark
        # A link that leads nowhere counts as a file.
        foreign = [] if ours else [name for name in names if os.path.lexists(place / name)]
    except (OSError, ValueError) as error:
        raise InvalidExport(f"cannot look into {str(folder)!r}: {error}") from error
    if exists and not fits:
        raise InvalidExport(f"{str(folder)!r} is not a folder")
    if not around:
        raise InvalidExport(
            f"folder {str(place.parent)!r}, in which {place.name!r} would be created, does not exist"
        )
    if foreign:
        raise InvalidExport(
            f"{str(folder)!r} holds {', '.join(sorted(foreign))}, which kinseek did not write; choose another folder"
        )
    return place


def write_files(place: Path, files: Mapping[str, bytes], stale: Collection[str] = ()) -> None:
    """Write files into a folder that `own_folder` has checked; make the folder if it is missing.

    Args:
        place: The folder.
        files: The content of each file, by its name.
        stale: Files of an earlier export, which are removed first.

    Raises:
        InvalidExport: The folder cannot be written.
    """
    try:
        place.mkdir(exist_ok=True)
        for name in stale:
            (place / name).unlink(missing_ok=True)
        for name, content in files.items():
            _write_anew(place / name, content)
    except OSError as error:
        raise InvalidExport(f"cannot write into {str(place)!r}: {error.strerror or error}") from error


def _beginning(path: Path, letters: int) -> str:
    with path.open(encoding="utf-8", errors="replace") as file:
        return file.read(letters)


def _write_anew(path: Path, content: bytes) -> None:
    """Replace a file or link; the target of a link stays unchanged."""
    path.unlink(missing_ok=True)
    with path.open("xb") as file:  # O_EXCL fails if a link appears meanwhile.
        file.write(content)
