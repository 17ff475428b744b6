"""The files of a map on disk: only this user may write to them, whatever the umask is, and only regular files are read.

It imports Zarr, so other modules import it only where a map is opened.
"""

from __future__ import annotations

import asyncio
import json
import os
import stat
import uuid
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from zarr.core.buffer.core import default_buffer_prototype
from zarr.storage import LocalStore

from kinseek.support.private import OTHERS_WRITE, make_folders

if TYPE_CHECKING:
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype

METADATA = "zarr.json"
MOST_BYTES = 2**20
"""Maximum size of a file of metadata [bytes]."""
MOST_BLOCK = 2**29 + 2**20
"""Maximum size of a file of a block [bytes]: a block of the most cells, of 8 bytes each, and what a codec may add."""
_ZSTD = b"\x28\xb5\x2f\xfd"
"""First bytes of a block."""
_MOST_PARTS = 2**16
"""Maximum number of parts of a frame of Zstandard; usually they have 128 KiB each."""


class LocalFiles(LocalStore):
    """As Zarr has them, but nobody else may write to a file from the moment that it exists."""

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Read a file; None if there is none.

        Raises:
            ValueError: See `get_sync`.
        """
        return await asyncio.to_thread(self.get_sync, key, prototype=prototype, byte_range=byte_range)

    def get_sync(
        self,
        key: str,
        *,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Read a file; None if there is none. It is checked when it is open, whatever its name leads to.

        Raises:
            ValueError: It is not a regular file, or too large, or metadata of a type with parameters, or a block that
                unpacks to more than a block can have; or only a part of it is wanted, as of shards, which no map has.
        """
        if byte_range is not None:
            raise ValueError(f"a part of {key!r} is asked for, expected the whole file")
        metadata = key.rpartition("/")[2] == METADATA
        most = MOST_BYTES if metadata else MOST_BLOCK
        try:
            content = _content(self.root / key, most)
        except (FileNotFoundError, NotADirectoryError):
            return None
        if content is None:
            raise ValueError(f"{key!r} is not a regular file of at most {most:,} bytes")
        (_require_plain if metadata else _require_small)(key, content)
        return (prototype or default_buffer_prototype()).buffer.from_bytes(content)

    async def set(self, key: str, value: Buffer) -> None:
        """Write a file, as a whole or not at all."""
        await asyncio.to_thread(self.set_sync, key, value)

    async def set_if_not_exists(self, key: str, default: Buffer) -> None:
        """Write a file that is not there."""
        if not await self.exists(key):
            await self.set(key, default)

    def set_sync(self, key: str, value: Buffer) -> None:
        """Write a file, as a whole or not at all."""
        self._check_writable()
        path = self.root / key
        make_folders(self.root, Path(key).parent)
        part = path.with_suffix(f".{uuid.uuid4().hex}.partial")
        try:
            with open(part, "xb", opener=_open) as file:
                file.write(value.to_bytes())
            part.replace(path)
        except BaseException:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise


def _require_plain(key: str, content: bytes) -> None:
    """Check that metadata describe no type with parameters: Zarr makes a value of it at once, and it may be gigabytes long.

    Raises:
        ValueError: They describe one, or may do so for other arrays, or are not JSON.
    """
    described = json.loads(content)
    if not isinstance(described, dict):
        return
    if not isinstance(described.get("data_type", ""), str):
        raise ValueError(f"{key!r} describes a type with parameters")
    if key != METADATA and described.get("consolidated_metadata"):  # Those of the store itself are not used.
        raise ValueError(f"{key!r} describes other arrays")


def _require_small(key: str, content: bytes) -> None:
    """Check that a block has at most `MOST_BLOCK` bytes when it is decoded: the decoder has no limit.

    Raises:
        ValueError: It has more, or is not one frame of Zstandard that says how many.
    """
    size = _stated_size(content)
    if size is None or size > MOST_BLOCK:
        raise ValueError(f"{key!r} does not unpack to at most {MOST_BLOCK:,} bytes")


def _stated_size(content: bytes) -> int | None:
    """Return the size that a frame of Zstandard states for its content, which decoders do not exceed (RFC 8878, 3.1.1).

    Args:
        content: The frame.

    Returns:
        The size; None if it is not stated, or if this is not a single frame.
    """
    if len(content) < 5 or not content.startswith(_ZSTD):
        return None
    flags = content[4]
    single, length = flags >> 5 & 1, (flags >> 5 & 1, 2, 4, 8)[flags >> 6]
    at = 6 - single + (0, 1, 2, 4)[flags & 3]
    size, at = int.from_bytes(content[at : at + length], "little"), at + length
    for _ in range(_MOST_PARTS):
        header, at = int.from_bytes(content[at : at + 3], "little"), at + 3
        at += 1 if header >> 1 & 3 == 1 else header >> 3  # The second kind of part repeats one byte.
        if header & 1 or at > len(content):
            break
    end = at + 4 * (flags >> 2 & 1)
    if not length or len(content) != end:
        return None
    return size + 256 if length == 2 else size


def _open(path: str, flags: int) -> int:
    return os.open(path, flags, 0o666 & ~OTHERS_WRITE)


def _content(path: Path, most: int) -> bytes | None:
    """Read a file; None if it is not a regular one, or larger than `most` bytes."""
    # A pipe would block, and a huge file or a device would fill the memory. Another file may have the name after this, so
    # the open file is checked, too.
    if not stat.S_ISREG(path.stat().st_mode):
        return None
    flags = [getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY")]
    file = os.open(path, os.O_RDONLY | sum(flags))
    try:
        status = os.fstat(file)
        if not stat.S_ISREG(status.st_mode) or status.st_size > most:
            return None
        with open(file, "rb", closefd=False) as opened:
            content = opened.read(most + 1)
    finally:
        os.close(file)
    return content if len(content) <= most else None
