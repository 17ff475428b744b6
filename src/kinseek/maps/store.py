"""Storage of maps in a Zarr store, written block by block, each once and completely.

The blocks are the chunks of the arrays. A block is marked when all its variables are written, and not before. So a block
without a mark is computed again, whatever the store has in its place. Zarr writes a chunk to a temporary file and then moves
it to its place.
"""

from __future__ import annotations

import json
import math
import os
import shlex
import shutil
import sys
import uuid
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidMap, reason
from kinseek.printable import printable
from kinseek.support.interrupts import raise_of_handler
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.private import OTHERS_WRITE, NotPrivate, make_folders, require_private

from .grid import grid_of

Array = NDArray[np.float64]
Index = tuple[int, ...]

DESCRIPTION = "kinseek"
"""Attribute with the description of the map; kinseek did not make a store without it."""

_DONE = "blocks/done"

_ROTATION = "rotation"
_METADATA = "zarr.json"
MOST_PLACES = 2**22
"""Maximum number of cells along one dimension of positions when a map is opened."""
MOST_BLOCKS = 2**18
"""Maximum number of blocks when a map is opened: 10¹¹ cells in blocks of the usual size. Each has an entry in a table of
tasks.
"""
MOST_CHUNK = 2**26
"""Maximum number of cells of a block when a map is opened."""
CODECS = frozenset({"bytes", "crc32c", "gzip", "zstd"})
"""Codecs that are read; Zarr writes zstd by itself. Blosc is not among them: some damaged blocks end the process in its
decoder.
"""


class Store(Lazy):
    """The arrays of a map, on disk or in memory; always in Zarr format 3, none of whose codecs unpickles data."""

    def __init__(self, group: Any, place: str) -> None:
        """Wrap a Zarr group; `place` is its name for messages."""
        self._group, self.place = group, place
        self.description: dict[str, Any] = group.attrs[DESCRIPTION]
        if not isinstance(self.description, dict) or not isinstance(self.description.get("variables"), list):
            raise ValueError(f"its attribute {DESCRIPTION!r} is not what maps.reach writes")
        self._folder: Path | None = getattr(group.store, "root", None)
        self._done = group[_DONE]

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
            description: Description of the map, with ``dims``, ``shape``, ``chunks`` and the names of ``variables``.
            variables: Type, fill value and attributes of each.
            coordinates: Dimensions, values and attributes of each.
            attributes: Attributes of the whole store.

        Raises:
            InvalidMap: The folder cannot be written.
        """
        import zarr
        from zarr.codecs import ZstdCodec
        from zarr.storage import MemoryStore

        from .local_files import LocalFiles

        # Without a checksum a damaged block may unpack to other numbers, and no error is raised.
        checked = ZstdCodec(checksum=True)
        dims, shape, chunks = description["dims"], tuple(description["shape"]), tuple(description["chunks"])
        making = None if path is None else path.with_name(f".{path.name}.{uuid.uuid4().hex}")
        try:
            if making is not None:
                make_folders(Path(making.anchor), making.parent.relative_to(making.anchor))
                making.mkdir(mode=0o777 & ~OTHERS_WRITE)
            memory: Any = MemoryStore() if making is None else LocalFiles(making)
            group = zarr.create_group(
                memory, zarr_format=3, attributes={**attributes, DESCRIPTION: description}
            )
            for name, (dtype, fill, report) in variables.items():
                group.create_array(
                    name,
                    shape=shape,
                    chunks=chunks,
                    dtype=dtype,
                    fill_value=fill,
                    compressors=checked,
                    dimension_names=dims,
                    attributes=report,
                )
            for name, (along, values, report) in coordinates.items():
                group.create_array(
                    name, data=values, compressors=checked, dimension_names=along, attributes=report
                )
            blocks = tuple(-(-n // chunk) for n, chunk in zip(shape, chunks, strict=True))
            group.create_array(
                _DONE,
                shape=blocks,
                chunks=(1,) * len(blocks),
                dtype="uint8",
                fill_value=0,
                compressors=checked,
            )
            if making is not None and path is not None:
                os.rename(making, path)
                return cls.at(str(path))
            return cls(group, "memory")
        except BaseException as error:  # Includes Ctrl-C.
            if making is not None:
                shutil.rmtree(making, ignore_errors=True)
            if isinstance(error, OSError):
                raise InvalidMap(f"the store {str(path)!r} cannot be made: {error}") from error
            raise

    @classmethod
    def at(cls, path: str, who: Callable[[], str] = lambda: "here") -> Store:
        """Return the store in a folder, opened once per process.

        Args:
            path: Its folder.
            who: Returns the name of the worker, for messages.

        Raises:
            InvalidMap: There is none.
        """
        try:
            stamp = os.stat(Path(path) / _METADATA)  # Another map may have replaced it.
            return _opened(path, stamp.st_ino, stamp.st_mtime_ns)
        except Exception as error:  # Zarr raises many kinds of errors for foreign metadata.
            raise_of_handler(error)
            raise InvalidMap(
                f"no map in {path!r} ({who()}): {reason(error)}. On a cluster the folder must be one that all workers see"
            ) from None

    def fixed(self) -> Store:
        """Return the store with its metadata as they are now: another user may replace their files at any time.

        Raises:
            ValueError: It is no map.
        """
        from .local_files import LocalFiles

        folder = self._folder
        return self if folder is None else Store(_group_in(LocalFiles(folder, known={})), self.place)

    @lazy
    def _arrays(self) -> dict[str, Any]:
        """The variables. They are opened when the description has been checked, which may name anything."""
        return {name: self._array(name) for name in self.description["variables"]}

    def _array(self, name: str) -> Any:
        """Open an array.

        Raises:
            InvalidMap: It is missing, or its metadata cannot be read.
        """
        try:
            return self._group[name]
        except Exception as error:  # Zarr raises many kinds of errors for foreign metadata.
            raise_of_handler(error)
            raise InvalidMap(
                f"no map in {self.place!r}: its array {name!r} cannot be read: {reason(error)}"
            ) from None

    @property
    def blocks(self) -> Index:
        """Number of blocks along each dimension."""
        return tuple(self._done.shape)

    def missing(self) -> list[Index]:
        """Blocks that are not written yet, in order.

        Raises:
            InvalidMap: A mark cannot be read.
        """
        try:
            done = np.asarray(self._done[...])
        except Exception as error:  # Codecs raise many kinds of errors.
            raise_of_handler(error)
            raise InvalidMap(
                f"the marks of finished blocks in '{self.place}/{_DONE}' cannot be read: {reason(error)}; remove a damaged "
                "one, and its block is computed again"
            ) from None
        return [tuple(int(i) for i in index) for index in np.argwhere(done == 0)]

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
        """The map as an ``xarray.Dataset`` that is read lazily.

        The coordinates and rotations of its cells are those of its grid. Texts among the attributes have escapes for
        characters that are not printable.
        """
        import dask.array
        import xarray

        grid = grid_of(self.description["grid"])
        places = dict(zip(grid.dims, (*grid.places, np.arange(grid.shape[-1])), strict=True))
        source = self._group.store
        with _quiet():
            attributes = {name: dict(self._group[name].attrs) for name in (*places, _ROTATION)}
            # Zarr opens all that it finds at once, and prints each failure; xarray reads arrays named like dimensions.
            if self._folder is not None:
                from .local_files import LocalFiles

                source = LocalFiles(self._folder, shown=frozenset(self._arrays), known=source.known)
            dataset = xarray.open_zarr(
                source,
                zarr_format=3,
                consolidated=False,
                chunks={},
                decode_cf=False,  # A foreign map may have attributes that xarray computes with.
            )
        dataset = dataset.assign_coords(
            {name: (name, each, attributes[name]) for name, each in places.items()}
        )
        # Not those of the store, which are zero if their block is missing. Made when they are needed: there may be millions.
        untyped: Any = dask
        made = untyped.delayed(_rotations, pure=True)(json.dumps(self.description["grid"]))
        rotations = untyped.array.from_delayed(made, (grid.shape[-1], 3, 3), float)
        along = ("orientation", "row", "column")
        dataset = dataset.assign_coords({_ROTATION: (along, rotations, attributes[_ROTATION])})
        with_attributes: list[Any] = [dataset, *dataset.variables.values()]
        for each in with_attributes:  # xarray prints texts as they are.
            each.attrs = {
                printable(name): printable(value) if isinstance(value, str) else value
                for name, value in each.attrs.items()
            }
        return dataset

    def require_sound(self, types: Mapping[str, tuple[str, float]]) -> None:
        """Check that the store matches its description, so that reading it takes no more than its grid requires.

        Args:
            types: Type of each variable, and its fill value.

        Raises:
            InvalidMap: Something is different.
        """
        description, grid = self.description, grid_of(self.description["grid"])
        chunks = description.get("chunks")
        if description.get("dims") != list(grid.dims) or description.get("shape") != list(grid.shape):
            raise self._unsound("its dimensions and shape are not those of its grid")
        if max(grid.shape[:-1]) > MOST_PLACES:
            raise self._unsound(
                f"it has {max(grid.shape[:-1]):,} cells in a row, at most {MOST_PLACES:,} are read"
            )
        if (
            not isinstance(chunks, list)
            or len(chunks) != len(grid.shape)
            or any(
                type(n) is not int or not 1 <= n <= most for n, most in zip(chunks, grid.shape, strict=True)
            )
            or math.prod(chunks) > MOST_CHUNK
        ):
            raise self._unsound(f"its blocks are of {chunks!r:.200} cells, at most {MOST_CHUNK:,} are read")
        blocks = tuple(-(-n // chunk) for n, chunk in zip(grid.shape, chunks, strict=True))
        if math.prod(blocks) > MOST_BLOCKS:
            raise self._unsound(f"it has {math.prod(blocks):,} blocks, at most {MOST_BLOCKS:,} are read")
        turns = (grid.shape[-1], 3, 3)
        self._require_array(_DONE, blocks, (1,) * len(blocks), "uint8", 0)
        self._require_array(_ROTATION, turns, None, "float64", 0.0, ("orientation", "row", "column"))
        for name in self._arrays:
            self._require_array(name, grid.shape, tuple(chunks), *types[name], grid.dims)

    def _require_array(
        self,
        name: str,
        shape: Index,
        chunks: Index | None,
        dtype: str,
        fill: float,
        dims: tuple[str, ...] | None = None,
    ) -> None:
        """Check that an array is as `create` makes it.

        With `chunks` None, any chunks no larger than the array are valid, at most `MOST_BLOCKS` of them.
        """
        array = self._array(name)
        codecs = [codec.to_dict()["name"] for codec in array.metadata.codecs]
        there = array.shape, array.dtype, array.metadata.dimension_names
        as_made = there == (shape, np.dtype(dtype), dims)
        if not as_made or repr(float(array.fill_value)) != repr(float(fill)):  # NaN equals nothing.
            raise self._unsound(f"its array {name!r} is not of the shape and type that maps.reach gives it")
        fits = all(n <= most for n, most in zip(array.chunks, shape, strict=True))
        fits = fits and math.prod(array.cdata_shape) <= MOST_BLOCKS  # Dask has an entry for each.
        if array.chunks != chunks and (chunks is not None or not fits):
            raise self._unsound(f"the chunks of its array {name!r} are not its blocks")
        if not CODECS.issuperset(codecs) or array.shards is not None:
            raise self._unsound(
                f"its array {name!r} is encoded by other codecs than {', '.join(sorted(CODECS))}"
            )
        # When a block is read, what it unpacks to is checked for one compression.
        if len(codecs) > len(set(codecs)) or {"gzip", "zstd"} <= set(codecs):
            raise self._unsound(f"its array {name!r} is compressed more than once")

    def _unsound(self, why: str) -> InvalidMap:
        return InvalidMap(f"no map in {self.place!r} that maps.reach made: {why}")


@lru_cache(maxsize=4)
def _opened(path: str, inode: int, changed: int) -> Store:
    from .local_files import LocalFiles

    return Store(_group_in(LocalFiles(path)), path)


def _group_in(files: Any) -> Any:
    """Open the Zarr group in some files.

    Raises:
        ValueError: It is of another format.
    """
    import zarr

    with _quiet():
        # Not consolidated: such metadata may describe arrays of the other format.
        group = zarr.open_group(files, mode="r+", zarr_format=3, use_consolidated=False)
    if group.metadata.zarr_format != 3:  # Zarr itself believes what zarr.json says of the format.
        raise ValueError("it is of Zarr format 2, which can hold pickles")
    return group


def _rotations(grid: str) -> Array:
    """Return the rotations of a grid that is described as JSON, (k, 3, 3)."""
    return grid_of(json.loads(grid)).orientations.matrices.copy()  # Those of a grid are kept for others.


def _forget_threads() -> None:
    """Let a forked child start threads of its own: Dask would wait for those of the parent, which the child has not got."""
    threaded: Any = sys.modules.get("dask.threaded")
    if threaded is not None:
        threaded.default_pool = None
        threaded.pools.clear()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_threads)


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress warnings of Zarr, which show names of files with characters that act on a terminal."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def compare(place: str, there: dict[str, Any], requested: dict[str, Any]) -> None:
    """Check that a store is of the requested map.

    Raises:
        InvalidMap: They differ; the message says in what.
    """
    other = [key for key in requested if there.get(key) != requested[key]]
    if other:
        differences = "; ".join(f"{key} is {there.get(key)!r}, requested {requested[key]!r}" for key in other)
        raise InvalidMap(
            f"the store {place!r} has another map: {differences}. Request the same map to continue it, or use another "
            "store"
        )


def require_own(path: Path) -> None:
    """Check that no other user can change a store, and that its folders are not links, which could redirect blocks.

    Of its files only the metadata are looked at: they say where blocks are and how they are encoded.

    Raises:
        InvalidMap: A folder or metadata belong to another user, others may write to them, or they are a link.
    """
    _require_own(path, path)
    for folder, names, files in os.walk(path):
        for name in (*names, *(each for each in files if each == _METADATA)):
            _require_own(path, Path(folder, name))


def _require_own(store: Path, folder: Path) -> None:
    # A store of this user may come from an archive with links. Blocks that are links are replaced, not followed.
    if folder.is_symlink():
        raise InvalidMap(
            f"the store {str(store)!r} holds a link, {str(folder.relative_to(store))!r}: blocks are only written to "
            "folders in the store. Use another store, or replace the link by its target"
        )
    try:
        require_private(folder, folder.lstat())
    except NotPrivate as error:
        at = shlex.quote(str(store))
        raise InvalidMap(
            f"{error}, and this is user {os.geteuid()}: blocks are only written where no other user can change them. "
            f"Use another store, or make this one private: chown -R {os.geteuid()} {at}; chmod -R go-w {at}"
        ) from None
