"""Where a map is kept: a Zarr store, written block by block, each once and whole.

The blocks are the chunks of the arrays. When all variables of a block are written, and not before, its mark is: so a block
without a mark is made anew, whatever lies there. Zarr writes a chunk beside its place and moves it there when it is whole.
"""

from __future__ import annotations

import os
import shutil
import uuid
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidMap

Array = NDArray[np.float64]
Index = tuple[int, ...]

DESCRIPTION = "kinseek"
"""Attribute that says what the map is of; a store without it is none of ours."""

_DONE = "blocks/done"


class Store:
    """A map's arrays, on disk or in memory; always of Zarr format 3, of which no codec unpickles anything."""

    def __init__(self, group: Any, place: str) -> None:
        """Wrap a Zarr group; `place` is its name for messages."""
        self._group, self.place = group, place
        self.description: dict[str, Any] = group.attrs[DESCRIPTION]
        self._done = group[_DONE]
        self._arrays = {name: group[name] for name in self.description["variables"]}

    @classmethod
    def create(
        cls,
        path: Path | None,
        description: dict[str, Any],
        variables: Mapping[str, tuple[str, float, dict[str, Any]]],
        coordinates: Mapping[str, tuple[tuple[str, ...], Array, dict[str, Any]]],
        attributes: dict[str, Any],
    ) -> Store:
        """Make a store without any block; it appears as a whole or not at all.

        Args:
            path: Its folder; None: in memory.
            description: What it is of; has ``dims``, ``shape``, ``chunks`` and the names of ``variables``.
            variables: Type, value where nothing is known, and attributes of each.
            coordinates: Dimensions, values and attributes of each.
            attributes: Of the whole.

        Raises:
            InvalidMap: The folder cannot be written.
        """
        import zarr
        from zarr.storage import LocalStore, MemoryStore

        dims, shape, chunks = description["dims"], tuple(description["shape"]), tuple(description["chunks"])
        making = None if path is None else path.with_name(f".{path.name}.{uuid.uuid4().hex}")
        try:
            memory: Any = MemoryStore() if making is None else LocalStore(making)
            group = zarr.create_group(
                memory, zarr_format=3, attributes={**attributes, DESCRIPTION: description}
            )
            for name, (dtype, fill, told) in variables.items():
                group.create_array(
                    name,
                    shape=shape,
                    chunks=chunks,
                    dtype=dtype,
                    fill_value=fill,
                    dimension_names=dims,
                    attributes=told,
                )
            for name, (along, values, told) in coordinates.items():
                group.create_array(name, data=values, dimension_names=along, attributes=told)
            blocks = tuple(-(-n // chunk) for n, chunk in zip(shape, chunks, strict=True))
            group.create_array(_DONE, shape=blocks, chunks=(1,) * len(blocks), dtype="uint8", fill_value=0)
            if making is not None and path is not None:
                os.rename(making, path)
                return cls.at(str(path))
            return cls(group, "memory")
        except OSError as error:
            if making is not None:
                shutil.rmtree(making, ignore_errors=True)
            raise InvalidMap(f"the store {str(path)!r} cannot be made: {error}") from error

    @classmethod
    def at(cls, path: str, who: Callable[[], str] = lambda: "here") -> Store:
        """The store in a folder, opened once a process.

        Args:
            path: Its folder.
            who: Says who does not find it.

        Raises:
            InvalidMap: There is none.
        """
        try:
            stamp = os.stat(Path(path) / "zarr.json")  # Another map may stand there since it was opened.
            return _opened(path, stamp.st_ino, stamp.st_mtime_ns)
        except (OSError, KeyError, ValueError) as error:
            raise InvalidMap(
                f"no map in {path!r} ({who()}): {error}. On a cluster the folder must be one that all workers see"
            ) from error

    @property
    def blocks(self) -> Index:
        """How many blocks there are along each dimension."""
        return tuple(self._done.shape)

    def missing(self) -> list[Index]:
        """Blocks that are not written yet, in order."""
        return [tuple(int(i) for i in index) for index in np.argwhere(np.asarray(self._done[...]) == 0)]

    def is_done(self, index: Index) -> bool:
        """Is a block written?"""
        return bool(self._done[index])

    def write(self, index: Index, values: Mapping[str, Array]) -> None:
        """Write a block, and then its mark.

        Raises:
            OSError: The disk is full, or cannot be written.
        """
        chunks = self.description["chunks"]
        part = tuple(slice(i * n, (i + 1) * n) for i, n in zip(index, chunks, strict=True))
        for name, array in self._arrays.items():
            array[part] = values[name]
        self._done[index] = self._done[index] + 1

    def dataset(self) -> Any:
        """The map as an ``xarray.Dataset``, read where it is used."""
        import xarray

        dataset = xarray.open_zarr(self._group.store, zarr_format=3, consolidated=False, chunks={})
        return dataset.set_coords([name for name in ("rotation",) if name in dataset])


@lru_cache(maxsize=4)
def _opened(path: str, inode: int, changed: int) -> Store:
    import zarr

    # Not consolidated: such metadata may describe arrays of the other format.
    group = zarr.open_group(path, mode="r+", zarr_format=3, use_consolidated=False)
    if group.metadata.zarr_format != 3:  # Zarr itself believes what zarr.json says of the format.
        raise ValueError("it is of Zarr format 2, which can hold pickles")
    return Store(group, path)


def compare(place: str, there: dict[str, Any], wanted: dict[str, Any]) -> None:
    """Refuse a store of another map.

    Raises:
        InvalidMap: They differ; the message says in what.
    """
    other = [key for key in wanted if there.get(key) != wanted[key]]
    if other:
        told = "; ".join(f"{key} {there.get(key)!r} there, {wanted[key]!r} asked" for key in other)
        raise InvalidMap(
            f"the store {place!r} is of another map: {told}. Ask for the same to go on with it, or take another store"
        )


def require_own(path: Path) -> None:
    """Refuse a store of another user: its maker may have put links into it, through which blocks are written elsewhere.

    Raises:
        InvalidMap: It belongs to another user.
    """
    if hasattr(os, "getuid") and (owner := path.lstat().st_uid) != os.getuid():
        raise InvalidMap(
            f"the store {str(path)!r} belongs to user {owner}, and this is user {os.getuid()}: blocks are only written "
            "to a folder of one's own. Take another store, or change its owner"
        )
