"""Files that a build keeps for the next one: each begins with a digest of the rest, because a crash may damage them."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

_DIGEST = hashlib.sha256().digest_size


def keep(path: Path, data: bytes) -> None:
    """Write a file atomically, with its digest."""
    new = path.with_name(f"{path.name}.{os.getpid()}.new")
    new.write_bytes(hashlib.sha256(data).digest() + data)
    new.rename(path)


def kept(path: Path) -> bytes | None:
    """Return what `keep` has written to a file, or None if it is missing or damaged."""
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None
    digest, data = content[:_DIGEST], content[_DIGEST:]
    return data if hashlib.sha256(data).digest() == digest else None
