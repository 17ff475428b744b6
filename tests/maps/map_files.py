"""A small map, and what lies in the folder of its store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import kinseek
from kinseek import maps

ARM = kinseek.load("ur5e")
GRID = maps.Grid((-0.9, 0.9, 0.3), (-0.9, 0.9, 0.3), (-0.3, 0.9, 0.3), maps.orientations(24))
SMALL: dict[str, Any] = {"block": 24 * 8}


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def marks(folder: Path) -> dict[Path, tuple[int, int]]:
    """Of the blocks that are done, when and as which file their marks and values were written."""
    done = (folder / "blocks" / "done" / "c").rglob("*")
    blocks = [path for path in done if path.is_file() and not path.name.endswith(".partial")]
    values = [folder / "reached" / path.parent.relative_to(folder / "blocks" / "done") for path in blocks]
    return {path: (path.stat().st_mtime_ns, path.stat().st_ino) for path in [*blocks, *values]}
