"""Files that a build keeps for the next one, each behind a digest of its name and content: a crash may damage them."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

_SIZE = hashlib.sha256().digest_size


def keep(path: Path, data: bytes) -> None:
    """Write a file atomically, with its digest."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    new.write_bytes(_digest(path, data) + data)
    new.rename(path)


def kept(path: Path) -> bytes | None:
    """Return what `keep` has written to a file, or None if it is missing or damaged."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    digest, data = content[:_SIZE], content[_SIZE:]
    return data if digest == _digest(path, data) else None


def _digest(path: Path, data: bytes) -> bytes:
    """Return a digest of a file's name and its content: a crash may exchange files, too."""
    return hashlib.sha256(path.name.encode() + b"\n" + data).digest()
