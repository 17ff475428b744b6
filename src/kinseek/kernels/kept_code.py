"""Machine code on disk, protected against damage and planted files; if it is not writable, a line on stderr reports it.

A crash or a full disk leaves files that are truncated or full of zeros. Numba trusts the files it finds, so every file
here begins with a digest of the rest. Machine code also names its call signature, since two processes that begin together
may give two signatures the same file. The digest has no key: it detects damage, not intent. A file is therefore read only
if it and all folders above it are private (`kinseek.support.private`).
"""

from __future__ import annotations

import hashlib
import os
import pickle
from pathlib import Path
from typing import Any

from numba.core import caching
from numba.core.ccallback import CFunc

from kinseek.support.notices import notice
from kinseek.support.private import NotPrivate, private_folder, read_private

_DIGEST = hashlib.sha256().digest_size

_report: set[str] = set()


def _report_once(what: str, line: str) -> None:
    """Print a line on stderr, once per process."""
    if what not in _report:
        _report.add(what)
        notice(line)


def _report_damaged(path: str, error: Exception) -> None:
    _report_once("damaged", f"compiling kernels anew, for their cache is damaged: {path} ({_words(error)})")


def _report_distrusted(error: Exception) -> None:
    _report_once("distrusted", f"compiling kernels anew, for others may have changed their cache: {error}")


def report_unwritten(folder: str | os.PathLike[str], error: Exception) -> None:
    """Report that compiled kernels cannot be kept."""
    _report_once(
        "unwritten", f"doing without a cache of compiled kernels, for {folder} takes none ({_words(error)})"
    )


def _words(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:200]


_Files: Any = caching.IndexDataCacheFile
_FunctionCache: Any = caching.FunctionCache
_CFunc: Any = CFunc
_Folder: Any = caching.UserProvidedCacheLocator


class _CheckedFiles(_Files):  # type: ignore[misc]
    """The files of one kernel: an index from call signatures to numbers, and one file of machine code for each."""

    def load(self, key: Any) -> Any:
        """Machine code for a call signature, or None."""
        name = self._load_index().get(key)
        if name is None:
            return None
        known = self._read(self._data_path(name))
        return known[1] if known is not None and known[0] == repr(key) else None

    def save(self, key: Any, data: Any) -> None:
        """Store machine code for a call signature."""
        super().save(key, (repr(key), data))

    def _load_index(self) -> Any:
        version, stamp, overloads = self._read(self._index_path) or (None, None, {})
        fresh = version == self._version and stamp == self._source_stamp
        return overloads if fresh else {}

    def _save_index(self, overloads: Any) -> None:
        self._write(self._index_path, (self._version, self._source_stamp, overloads))

    def _save_data(self, name: str, data: Any) -> None:
        self._write(self._data_path(name), data)

    def _read(self, path: str) -> Any:
        """Contents of a file, or None if it is missing or damaged."""
        try:
            content = read_private(Path(path))
            if hashlib.sha256(content[_DIGEST:]).digest() != content[:_DIGEST]:
                raise ValueError(f"it does not hold what was written, {len(content)} bytes are left")
            return pickle.loads(content[_DIGEST:])
        except FileNotFoundError:
            return None
        except NotPrivate as error:
            _report_distrusted(error)
            return None
        except Exception as error:
            _report_damaged(path, error)
            return None

    def _write(self, path: str, value: Any) -> None:
        data = self._dump(value)
        with self._open_for_write(path) as file:
            if hasattr(
                os, "fchmod"
            ):  # With some umasks others may write to it, and `_read` rejects such a file.
                os.fchmod(file.fileno(), 0o600)
            file.write(hashlib.sha256(data).digest() + data)


class _PrivateFolder(_Folder):  # type: ignore[misc]
    """A folder for each source folder, inside one of ours for each state of the sources."""

    def ensure_cache_path(self) -> None:
        """Create it for this user only; Numba would follow links and apply the umask."""
        folder = Path(self.get_cache_path())
        private_folder(folder.parents[1], folder.parent.name, folder.name)
        super().ensure_cache_path()


class _OurFolder(caching.CompileResultCacheImpl):
    """Files in our folder only: beside the sources, where Numba would go next, they would outlive a change of these."""

    _locator_classes = [_PrivateFolder]  # noqa: RUF012


class _KeptCode(_FunctionCache):  # type: ignore[misc]
    """Numba's cache of one kernel, without its trust in files."""

    _impl_class = _OurFolder

    def __init__(self, function: Any) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            cache_path=self._cache_path,
            filename_base=self._impl.filename_base,
            source_stamp=self._impl.locator.get_source_stamp(),
        )

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Machine code, ready to run, or None."""
        try:
            return super().load_overload(sig, target_context)
        except Exception as error:
            _report_damaged(self._cache_path, error)
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Store machine code if the disk accepts it."""
        try:
            super().save_overload(sig, data)
        except OSError as error:
            report_unwritten(self._cache_path, error)


def keep_code(compiled: Any, function: Any, folder: Path) -> None:
    """Make a compiled function, a dispatcher or a C function, load its machine code from our folder and store it there."""
    try:
        compiled._cache = _KeptCode(function)
    except (OSError, RuntimeError) as error:  # Numba found no place in the folder.
        report_unwritten(folder, error)


def c_function(signature: Any, function: Any, options: dict[str, Any], folder: Path | None) -> Any:
    """Compile a C function, or read it from disk."""
    compiled = _CFunc(function, signature, {}, options)
    if folder is not None:
        keep_code(compiled, function, folder)
    compiled.compile()
    return compiled
