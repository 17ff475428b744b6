"""The one place that holds Numba's options, and the guard against stale machine code.

Numba's disk cache looks only at the file that holds the compiled function: a kernel whose imported callee
changed in another file would run on with the old machine code. So the cache lives in a folder named after a
digest of every source file that holds a kernel or that kernels are made of: change any of them, reinstall in
place, and the folder is a new one. Files without kernels may change freely.

Floating point: results hold no NaN (the shell refuses them), the sign of zero carries no meaning, and a
product may be fused with a sum. Sums are never reordered.
"""

from __future__ import annotations

import hashlib
import os
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import config, event, sigutils
from numba.core.types import unliteral

from .kept_code import c_function, keep_code
from .without_jit import WITHOUT_JIT, address_of, plainly

P = ParamSpec("P")
R = TypeVar("R")

_PACKAGE = Path(__file__).resolve().parent.parent


def kernel_sources(package: Path = _PACKAGE) -> list[Path]:
    """Every file whose text machine code depends on: all of `kernels/`, and what takes a decorator from this file.

    A kernel may use nothing of ours from any other file; tests/test_jit_cache.py looks.
    """
    kernels = package / "kernels"
    return [
        path
        for path in sorted(package.rglob("*.py"))
        if path.is_relative_to(kernels) or b"kernels.jit import" in path.read_bytes()
    ]


def source_digest(package: Path = _PACKAGE) -> str:
    """Return a digest of `kernel_sources` and of Numba's version."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in kernel_sources(package):
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


NUMERICS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"nnan", "nsz", "contract"}}

_njit: Any = numba.njit  # Its stubs leave out `no_cfunc_wrapper`, which saves compile time.
_signature_of: Callable[[str], Any] = sigutils.normalize_signature
_unliteral: Callable[[Any], Any] = unliteral


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile on first call, keep the machine code on disk, release the GIL while running."""
    return plainly(_compile(function)) if WITHOUT_JIT else _compile(function)


def inner(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel: always inlined, and without reference counts, so it must not allocate or hand back arrays.

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
    return _compile(function, _nrt=True, no_cpython_wrapper=True)


def view(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a hidden kernel that makes or hands back views of memory somebody else owns.

    What hands back an array or a bundle must count references: its caller gives one back. It has to be said, else Numba
    leaves counting out where the first that calls it, of all, does.
    """
    return _compile(function, forceinline=True, _nrt=True, no_cpython_wrapper=True)


def spliced(function: Callable[P, R]) -> Callable[P, R]:
    """Make a long function part of the one kernel that calls it, before anything is compiled: it is compiled once less."""
    return _compile(function, inline="always")


def exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile an inner kernel that never fuses a product with a sum: the same bits as NumPy, wherever inlined."""
    return _compile(function, forceinline=True, _nrt=False, fastmath=False)


def kernel_exact(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a kernel that may meet NaN, and must not assume it away."""
    compiled = _compile(function, fastmath=False)
    return plainly(compiled) if WITHOUT_JIT else compiled


class Routine:
    """A function that kernels call by its address: its machine code is made once, and never again for what calls it.

    What Numba links into a kernel it optimises anew with that kernel, and with all that call that one in turn: of a
    search that is four calls deep most of the compile time went there. See `pointers.call`.
    """

    def __init__(self, signature: str, function: Callable[..., int]) -> None:
        """Remember what to compile, as a C function of this signature: numbers, and memory by address."""
        self._signature, self._function = signature, function
        self._compiled: Any = None  # Kept: with it goes its machine code.

    @property
    def address(self) -> int:
        """Where its machine code stands, compiled by now or read from disk."""
        if WITHOUT_JIT:
            return address_of(self._function)
        return undisturbed(self._address)

    def _address(self) -> int:
        with _one_thread:
            if self._compiled is None:
                options = {"nopython": True} | NUMERICS
                with _cached():
                    signature = _signature_of(self._signature)
                    self._compiled = c_function(signature, self._function, options, _CACHE)
            address: int = self._compiled.address
            return address


_one_thread = threading.Lock()


def undisturbed(work: Callable[[], R]) -> R:
    """Compile something, or read it from disk, where no signal handler runs: in a thread of its own.

    Handlers run in the main thread, and may raise in the middle of what LLVM asks of Numba; LLVM goes on without the
    answer, and the kernel has no machine code. So the main thread waits, hears Ctrl-C at once, and what was begun is
    finished behind it.
    """
    if threading.current_thread() is not threading.main_thread():
        return work()
    result = Future[R]()

    def run() -> None:
        try:
            result.set_result(work())
        except BaseException as error:
            result.set_exception(error)

    threading.Thread(target=run, name="kinseek compiles").start()
    return result.result()


def routine(signature: str) -> Callable[[Callable[..., int]], Routine]:
    """Make a `Routine` of a function that hands back an integer; compiled when its address is asked."""
    return lambda function: Routine(signature, function)


@contextmanager
def _cached() -> Iterator[None]:
    """Let Numba keep what is decorated here in our folder: it reads its settings when it builds a function's cache."""
    settings = vars(config)
    ours = {"CACHE_DIR": str(_CACHE or ""), "CACHE_LOCATOR_CLASSES": ""}
    before = {name: settings.get(name, "") for name in ours}
    settings.update(ours)
    try:
        yield
    finally:
        settings.update(before)


def exposed(function: Callable[P, R]) -> Callable[P, R]:
    """Let Python call a hidden kernel, to test it or to draw what it does."""
    compiled: Any = function

    def call(*given: Any) -> Any:
        return compiled(*given)

    return cast("Callable[P, R]", _njit(call))


def _compile(function: Callable[P, R], **options: Any) -> Callable[P, R]:
    compiled = _njit(nogil=True, no_cfunc_wrapper=True, **(NUMERICS | options))(function)
    if not WITHOUT_JIT:
        if _CACHE is not None:
            with _cached():
                keep_code(compiled, function, _CACHE)
        _ignore_literals(compiled)
        _compile_undisturbed(compiled)
    return cast("Callable[P, R]", compiled)


def _compile_undisturbed(compiled: Any) -> None:
    compile_for_args = compiled._compile_for_args
    compiled._compile_for_args = lambda *args, **kws: undisturbed(lambda: compile_for_args(*args, **kws))


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
                "kinseek: compiling kernels, once per machine and version (some twenty seconds) ...",
                file=sys.stderr,
            )

    def on_end(self, details: Any) -> None:
        """Nothing to say."""


_register: Callable[[str, event.Listener], None] = event.register
_register("numba:compile", _FirstRunNotice())
