"""The files of a map on disk: only this user may write to them, whatever the umask is, and metadata are small regular files.

Imported where a map is opened, for it imports Zarr.
"""

from __future__ import annotations

import asyncio
import os
import stat
import uuid
from collections.abc import AsyncIterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from zarr.core.buffer.core import default_buffer_prototype
from zarr.storage import LocalStore

from kinseek.support.private import OTHERS_WRITE

if TYPE_CHECKING:
    from zarr.abc.store import ByteRequest
    from zarr.core.buffer import Buffer, BufferPrototype

METADATA = "zarr.json"
MOST_BYTES = 2**20
"""Maximum size of a file of metadata [bytes]."""


class LocalFiles(LocalStore):
    """As Zarr has them, but nobody else may write to a file from the moment that it exists."""

    def __init__(
        self, root: Path | str, *, read_only: bool = False, shown: frozenset[str] | None = None
    ) -> None:
        """Keep files in a folder; `shown` are the names in it that are listed, None: all."""
        super().__init__(root, read_only=read_only)
        self.shown = shown

    def with_read_only(self, read_only: bool = False) -> LocalFiles:
        """Make the same, to read alone or to write, too."""
        return type(self)(self.root, read_only=read_only, shown=self.shown)

    async def list_dir(self, prefix: str) -> AsyncIterator[str]:
        """List what lies in a folder."""
        async for name in super().list_dir(prefix):
            if self.shown is None or prefix.strip("/") or name in self.shown:
                yield name

    async def get(
        self,
        key: str,
        prototype: BufferPrototype | None = None,
        byte_range: ByteRequest | None = None,
    ) -> Buffer | None:
        """Read a file; None if there is none. Metadata are checked when they are open, whatever their name leads to.

        Raises:
            ValueError: A file of metadata is not a regular file, or too large.
        """
        if key.rpartition("/")[2] != METADATA:
            return await super().get(key, prototype, byte_range)
        try:
            text = await asyncio.to_thread(_metadata, self.root / key)
        except (FileNotFoundError, NotADirectoryError):
            return None
        if text is None:
            raise ValueError(f"{key!r} is not a regular file of at most {MOST_BYTES:,} bytes")
        return (prototype or default_buffer_prototype()).buffer.from_bytes(text)

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
        path.parent.mkdir(parents=True, exist_ok=True)
        part = path.with_suffix(f".{uuid.uuid4().hex}.partial")
        try:
            with open(part, "xb", opener=_open) as file:
                file.write(value.to_bytes())
            part.replace(path)
        except BaseException:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise


def _open(path: str, flags: int) -> int:
    return os.open(path, flags, 0o666 & ~OTHERS_WRITE)


def _metadata(path: Path) -> bytes | None:
    """Read a file of metadata; None if it is something else, or too large."""
    # A pipe would block, and a huge file or a device would fill the memory. Another file may have the name after this, so
    # the open file is checked, too.
    if not stat.S_ISREG(path.stat().st_mode):
        return None
    flags = [getattr(os, name, 0) for name in ("O_NONBLOCK", "O_CLOEXEC", "O_BINARY")]
    file = os.open(path, os.O_RDONLY | sum(flags))
    try:
        if not stat.S_ISREG(os.fstat(file).st_mode):
            return None
        with open(file, "rb", closefd=False) as opened:
            text = opened.read(MOST_BYTES + 1)
    finally:
        os.close(file)
    return text if len(text) <= MOST_BYTES else None
