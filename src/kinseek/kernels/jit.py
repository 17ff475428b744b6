"""The one place that holds Numba's options, and the guard against stale machine code.

Numba's disk cache looks only at the file that holds the compiled function: a kernel whose imported callee
changed in another file would run on with the old machine code. So the cache lives in a folder named after a
digest of every source file of the package: change any of them, reinstall in place, and the folder is a new
one.

Floating point: results hold no NaN (the shell refuses them), the sign of zero carries no meaning, and a
product may be fused with a sum. Sums are never reordered.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import config, event
from numba.core.types import unliteral

P = ParamSpec("P")
R = TypeVar("R")

_PACKAGE = Path(__file__).resolve().parent.parent


def source_digest(package: Path = _PACKAGE) -> str:
    """Return a digest of all Python sources of the package and of Numba's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sorted(package.rglob("*.py")):
        digest.update(str(path.relative_to(package)).encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _cache_folder() -> Path | None:
    """Return a writable folder for this very state of the sources, or None where there is none."""
    user_cache = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or "~/.cache"
    candidates = [
        os.environ.get("NUMBA_CACHE_DIR"),
        str(Path(user_cache).expanduser() / "kinseek"),
        str(Path(tempfile.gettempdir()) / f"kinseek-{os.getuid() if hasattr(os, 'getuid') else 'user'}"),
    ]
    for candidate in filter(None, candidates):
        folder = Path(candidate) / f"kinseek-{source_digest()}"
        try:
            folder.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            folder.mkdir(exist_ok=True, mode=0o700)
            with tempfile.TemporaryFile(dir=folder):
                if _is_ours(folder.parent) and _is_ours(folder):
                    return folder
        except OSError:
            continue
    return None


def _is_ours(folder: Path) -> bool:
    """Return whether nobody else can put machine code there: a shared temporary folder invites it."""
    status = folder.stat()
    return not hasattr(os, "getuid") or (status.st_uid == os.getuid() and not status.st_mode & stat.S_IWOTH)


_CACHE = _cache_folder()


_njit: Any = numba.njit  # Its stubs leave out `no_cfunc_wrapper`, which saves compile time.
_unliteral: Callable[[Any], Any] = unliteral


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile on first call, keep the machine code on disk, release the GIL while running."""
    return _compile(function)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel: always inlined, and without reference counts, so it must not allocate.

    Handing a bundle of arrays to a function costs more than a short function does: some 200 ns for twenty arrays, half of
    it for counting references.
    """
    return _compile(function, forceinline=True, _nrt=False)


def hidden(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that Python never calls: without the wrapper, which takes longer than the kernel."""
    return _compile(function, forceinline=True, _nrt=False, no_cpython_wrapper=True)


def called(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a hidden kernel that is long, and call it: inlining would compile it for every place that needs it.

    It takes handles and memory by address: a bundle of arrays as an argument is a hundred arguments.
    """
    return _compile(function, no_cpython_wrapper=True)


def view(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a hidden kernel that makes or hands back views of memory somebody else owns.

    What hands back an array or a bundle must count references: its caller gives one back.
    """
    return _compile(function, forceinline=True, no_cpython_wrapper=True)


def exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that never fuses a product with a sum: the same bits as NumPy, wherever inlined."""
    return _compile(function, forceinline=True, _nrt=False, fastmath=False)


def kernel_exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that may meet NaN, and must not assume it away."""
    return _compile(function, fastmath=False)


def _compile(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    settings = vars(config)
    before = settings["CACHE_DIR"]
    settings["CACHE_DIR"] = str(_CACHE or "")  # Read by Numba when the decorator builds the function's cache.
    try:
        compiled = _njit(
            cache=_CACHE is not None,
            nogil=True,
            error_model="numpy",
            no_cfunc_wrapper=True,
            **({"fastmath": {"nnan", "nsz", "contract"}} | options),
        )(function)
    finally:
        settings["CACHE_DIR"] = before
    if hasattr(compiled, "get_call_template"):  # Not so under NUMBA_DISABLE_JIT=1.
        _ignore_literals(compiled)
    return cast("Callable[P, R]", compiled)


def _ignore_literals(compiled: Any) -> None:
    """Let a kernel be compiled once, not anew for each constant that another kernel calls it with."""
    template = compiled.get_call_template

    def general(args: Iterable[Any], kws: Mapping[str, Any]) -> Any:
        return template(
            tuple(_unliteral(arg) for arg in args), {name: _unliteral(kw) for name, kw in kws.items()}
        )

    compiled.get_call_template = general


class _FirstRunNotice(event.Listener):
    """Say once, on stderr, that kernels are being compiled."""

    said = False

    def on_start(self, details: Any) -> None:
        """Numba is about to compile: ours, and not found in the cache."""
        function = getattr(details.data.get("dispatcher"), "py_func", None)
        if not self.said and getattr(function, "__module__", "").startswith("kinseek."):
            _FirstRunNotice.said = True
            print(
                "kinseek: compiling kernels, once per machine and version (some seconds) ...", file=sys.stderr
            )

    def on_end(self, details: Any) -> None:
        """Nothing to say."""


_register: Callable[[str, event.Listener], None] = event.register
_register("numba:compile", _FirstRunNotice())
