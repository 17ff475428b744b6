"""What lies in the folder of a map's store."""

from __future__ import annotations

from pathlib import Path


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def marks(folder: Path) -> dict[Path, tuple[int, int]]:
    """Of the blocks that are done, when and as which file their marks and values were written."""
    done = (folder / "blocks" / "done" / "c").rglob("*")
    blocks = [path for path in done if path.is_file() and not path.name.endswith(".partial")]
    values = [folder / "reached" / path.relative_to(folder / "blocks" / "done") for path in blocks]
    return {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in [*blocks, *values]}
