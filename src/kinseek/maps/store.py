"""Storage of maps in a Zarr store, written block by block, each once and completely.

The blocks are the chunks of the arrays. A block is marked when all its variables are written, and not before. So a block
without a mark is computed again, whatever the store has in its place. Zarr writes a chunk to a temporary file and then moves
it to its place.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import shlex
import shutil
import sys
import uuid
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidMap, reason
from kinseek.printable import printable
from kinseek.support.interrupts import raise_of_handler, uninterrupted
from kinseek.support.lazy import Lazy, lazy
from kinseek.support.private import OTHERS_WRITE, NotPrivate, make_folders, require_private

from .grid import grid_of
from .variables import coordinates_of, is_possible, variables_of

Array = NDArray[np.float64]
Index = tuple[int, ...]
R = TypeVar("R")

DESCRIPTION = "kinseek"
"""Attribute with the description of the map; kinseek did not make a store without it."""

_DONE = "blocks/done"

_MARK = "uint32"
_METADATA = "zarr.json"
DIGEST = "digest"
"""Key of the digest in a description."""
MOST_BLOCKS = 2**18
"""Maximum number of blocks: 10¹¹ cells in blocks of the usual size. Each has an entry in a table of tasks."""
MOST_CHUNK = 2**26
"""Maximum number of cells of a block."""
CODECS = ["bytes", "zstd"]
"""Codecs of each array, in order. Some damaged blocks end the process in the decoder of Blosc."""


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
    def create(cls, path: Path | None, description: dict[str, Any], attributes: dict[str, Any]) -> Store:
        """Make a store without any block; it appears as a whole or not at all.

        Args:
            path: Its folder; None: in memory.
            description: Description of the map, with the description of its ``grid``, its ``dims``, ``shape`` and
                ``chunks``, and the names of its ``variables``.
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
        grid = grid_of(description["grid"])
        dims, shape, chunks = description["dims"], tuple(description["shape"]), tuple(description["chunks"])
        making = None if path is None else path.with_name(f".{path.name}.{uuid.uuid4().hex}")
        try:
            if making is not None:
                make_folders(Path(making.anchor), making.parent.relative_to(making.anchor))
                making.mkdir(mode=0o777 & ~OTHERS_WRITE)
            memory: Any = MemoryStore() if making is None else LocalFiles(making)
            about = {**attributes, DESCRIPTION: signed(description)}
            group = _to_end(lambda: zarr.create_group(memory, zarr_format=3, attributes=about))

            def make(name: str, **what: Any) -> None:
                _to_end(lambda: group.create_array(name, compressors=checked, **what))

            for name, variable in variables_of(description, grid).items():
                make(
                    name,
                    shape=shape,
                    chunks=chunks,
                    dtype=variable.dtype,
                    fill_value=variable.fill,
                    dimension_names=dims,
                    attributes=variable.attributes,
                )
            for name, (along, values, report) in coordinates_of(grid, grid.orientations.matrices).items():
                make(name, data=values, dimension_names=along, attributes=report)
            variables = len(description["variables"])
            make(
                _DONE,
                shape=(*blocks_of(shape, chunks), variables),
                chunks=(*(1 for _ in shape), variables),
                dtype=_MARK,
                fill_value=0,
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
        return self if folder is None else Store(_group_in(LocalFiles(folder)), self.place)

    @lazy
    def _arrays(self) -> dict[str, Any]:
        """The variables. They are opened when the description has been checked, which may name anything.

        Raises:
            InvalidMap: One is missing, or its metadata cannot be read.
        """
        arrays = {}
        for name in self.description["variables"]:
            try:
                arrays[name] = _to_end(partial(self._group.__getitem__, name))
            except Exception as error:  # Zarr raises many kinds of errors for foreign metadata.
                raise_of_handler(error)
                raise InvalidMap(
                    f"no map in {self.place!r}: its array {name!r} cannot be read: {reason(error)}"
                ) from None
        return arrays

    @property
    def blocks(self) -> Index:
        """Number of blocks along each dimension."""
        return tuple(self._done.shape[:-1])

    def missing(self) -> list[Index]:
        """Blocks that are not written yet, in order.

        Raises:
            InvalidMap: A mark cannot be read.
        """
        return [index for index in np.ndindex(self.blocks) if not self.is_done(index)]

    def is_done(self, index: Index) -> bool:
        """Return whether a block is written.

        Raises:
            InvalidMap: Its mark cannot be read.
        """
        return bool(self._mark(index).any())

    def _mark(self, index: Index) -> NDArray[np.uint32]:
        """Return the mark of a block: for each variable the checksum of its values, or zeros if it is not written."""
        # Most blocks of a new map have no mark, and Zarr takes half a millisecond to find that out.
        if self._folder is not None and not os.path.lexists(self._file(_DONE, index)):
            if not os.path.lexists(self._folder / _METADATA):
                raise InvalidMap(f"the map in {self.place!r} is gone")
            return np.zeros(self._done.shape[-1], _MARK)
        try:
            return np.asarray(_to_end(lambda: self._done[index]))
        except Exception as error:  # Codecs raise many kinds of errors.
            raise_of_handler(error)
            raise InvalidMap(
                f"the mark {self._file(_DONE, index)!r} of a finished block cannot be read: {reason(error)}. Remove it, and "
                "maps.reach computes the block again"
            ) from None

    def _file(self, name: str, index: Index) -> str:
        """Return the file of a block, or of its mark."""
        return "/".join((self.place, name, "c", *map(str, index), *("0" if name == _DONE else "")))

    def _checksum(self, name: str, index: Index, values: Array) -> int:
        """Return the checksum of a variable in a block. It is another one in another block or map."""
        whose = "/".join((self.description[DIGEST], name, *map(str, index)))
        # Many patterns of bits are NaN, and a block that has nothing else is not written.
        alike = np.where(np.isnan(values), self._arrays[name].fill_value, values)
        return zlib.crc32(np.ascontiguousarray(alike).data, zlib.crc32(whose.encode()))

    def _part(self, index: Index) -> tuple[slice, ...]:
        sizes = zip(index, self.description["chunks"], self.description["shape"], strict=True)
        return tuple(slice(i * chunk, min((i + 1) * chunk, n)) for i, chunk, n in sizes)

    def write(self, index: Index, values: Mapping[str, Array]) -> None:
        """Write a block, and then its mark.

        Raises:
            OSError: The disk is full, or cannot be written.
        """
        mark = []
        for name, array in self._arrays.items():
            block = np.asarray(values[name], array.dtype)
            _to_end(partial(array.__setitem__, self._part(index), block))
            mark.append(self._checksum(name, index, block))
        _to_end(partial(self._done.__setitem__, index, np.array(mark, _MARK)))

    def read(self, name: str, block_id: Index) -> Array:
        """Return the values of a variable in a block, or its fill value everywhere if the block is not finished.

        Raises:
            InvalidMap: They cannot be read, or are not those that were written.
        """
        array, part, mark = self._arrays[name], self._part(block_id), self._mark(block_id)
        if not mark.any():
            return np.full([some.stop - some.start for some in part], array.fill_value, array.dtype)
        try:
            values = np.asarray(_to_end(lambda: array[part]))
            if self._checksum(name, block_id, values) != mark[[*self._arrays].index(name)]:
                raise ValueError("they are not the values that were written")
            if not is_possible(name, values):
                raise ValueError("maps.reach computes no such values")
        except Exception as error:  # Codecs raise many kinds of errors.
            raise_of_handler(error)
            raise InvalidMap(
                f"the values of the map in {self._file(name, block_id)!r} cannot be read: {reason(error)}. Remove its mark, "
                f"{self._file(_DONE, block_id)!r}, and maps.reach computes the block again"
            ) from None
        return values

    def dataset(self) -> Any:
        """The map as an ``xarray.Dataset`` that is read lazily.

        The coordinates and rotations of its cells, and all attributes of its variables, follow from its description. Texts
        among the attributes have escapes for characters that are not printable.
        """
        import dask.array
        import xarray

        grid = grid_of(self.description["grid"])
        blocks = tuple(
            tuple(min(chunk, n - at) for at in range(0, n, chunk))
            for n, chunk in zip(grid.shape, self.description["chunks"], strict=True)
        )
        untyped: Any = dask
        variables = {}
        for name, variable in variables_of(self.description, grid).items():
            values = untyped.array.map_blocks(
                self.read,
                name,
                name=f"{name}-{uuid.uuid4().hex}",
                chunks=blocks,
                meta=np.empty((0,) * len(blocks), variable.dtype),
            )
            variables[name] = grid.dims, values, variable.attributes
        # Made when they are needed: there may be millions.
        made = untyped.delayed(_rotations, pure=True)(json.dumps(self.description["grid"]))
        rotations = untyped.array.from_delayed(made, (grid.shape[-1], 3, 3), float)
        dataset = xarray.Dataset(variables, coordinates_of(grid, rotations), dict(self._group.attrs))
        with_attributes: list[Any] = [dataset, *dataset.variables.values()]
        for each in with_attributes:  # xarray prints texts as they are.
            each.attrs = {
                printable(name): printable(value) if isinstance(value, str) else value
                for name, value in each.attrs.items()
            }
        return dataset

    def require_sound(self) -> None:
        """Check that the store matches its description, so that reading it takes no more than its grid requires.

        Raises:
            InvalidMap: Something is different.
        """
        description, grid = self.description, grid_of(self.description["grid"])
        chunks = description.get("chunks")
        if description.get("dims") != list(grid.dims) or description.get("shape") != list(grid.shape):
            raise self._unsound("its dimensions and shape are not those of its grid")
        if (
            not isinstance(chunks, list)
            or len(chunks) != len(grid.shape)
            or any(
                type(n) is not int or not 1 <= n <= most for n, most in zip(chunks, grid.shape, strict=True)
            )
            or math.prod(chunks) > MOST_CHUNK
        ):
            raise self._unsound(f"its blocks are of {chunks!r:.200} cells, at most {MOST_CHUNK:,} are read")
        blocks = blocks_of(grid.shape, chunks)
        if math.prod(blocks) > MOST_BLOCKS:
            raise self._unsound(f"it has {math.prod(blocks):,} blocks, at most {MOST_BLOCKS:,} are read")
        variables = variables_of(description, grid)
        one = (*(1 for _ in blocks), len(variables))
        self._require_array(self._done, (*blocks, len(variables)), one, _MARK, 0)
        for name, each in variables.items():
            array = self._arrays[name]
            self._require_array(array, grid.shape, tuple(chunks), each.dtype, each.fill)
            if array.metadata.dimension_names != grid.dims:
                raise self._unsound(f"the dimensions of its array {name!r} are not those of its grid")

    def _require_array(self, array: Any, shape: Index, chunks: Index, dtype: str, fill: float) -> None:
        """Check that an array is as `create` makes it."""
        as_made = (array.shape, array.dtype) == (shape, np.dtype(dtype))
        if not as_made or repr(float(array.fill_value)) != repr(float(fill)):  # NaN equals nothing.
            raise self._unsound(
                f"its array {array.path!r} is not of the shape and type that maps.reach gives it"
            )
        if array.chunks != chunks:
            raise self._unsound(f"the chunks of its array {array.path!r} are not its blocks")
        codecs = [codec.to_dict()["name"] for codec in array.metadata.codecs]
        if codecs != CODECS:
            raise self._unsound(
                f"its array {array.path!r} is encoded by other codecs than {', '.join(CODECS)}"
            )

    def _unsound(self, why: str) -> InvalidMap:
        return InvalidMap(f"no map in {self.place!r} that maps.reach made: {why}")


def signed(description: dict[str, Any]) -> dict[str, Any]:
    """Return a description of a map with a digest of all of it, by which damage is noticed."""
    rest = {key: value for key, value in description.items() if key != DIGEST}
    text = json.dumps(rest, sort_keys=True)
    return {**rest, DIGEST: hashlib.sha256(text.encode()).hexdigest()[:16]}


def blocks_of(shape: Sequence[int], chunks: Sequence[int]) -> Index:
    """Return the number of blocks along each dimension."""
    return tuple(-(-n // chunk) for n, chunk in zip(shape, chunks, strict=True))


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
        group = _to_end(lambda: zarr.open_group(files, mode="r+", zarr_format=3, use_consolidated=False))
    if group.metadata.zarr_format != 3:  # Zarr itself believes what zarr.json says of the format.
        raise ValueError("it is of Zarr format 2, which can hold pickles")
    return group


def _to_end(call: Callable[[], R]) -> R:
    """Call Zarr, and wait for the end of the call if a signal handler raises."""
    # Otherwise Zarr's own thread goes on with it, and prints errors when Python ends.
    return uninterrupted(call, stop=lambda: None)


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
    keys = [*requested, *(key for key in there if key not in requested and key != DIGEST)]
    other = [key for key in keys if there.get(key) != requested.get(key)]
    if other:
        differences = "; ".join(
            f"{key} is {there.get(key)!r}, requested {requested.get(key)!r}" for key in other
        )
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
    status = folder.lstat()
    try:
        require_private(folder, status)
    except NotPrivate as error:
        cure = f"make this one private: chmod -R go-w {shlex.quote(str(store))}"
        if status.st_uid != os.geteuid():
            cure = "if you trust this one, a copy of it that belongs to you"
        raise InvalidMap(
            f"{error}, and this is user {os.geteuid()}: blocks are only written where no other user can change them. "
            f"Use another store, or {cure}"
        ) from None
