"""The one place that holds Numba's options, and the guard against stale machine code.

Numba's disk cache looks only at the file that holds the compiled function: a kernel whose imported callee
changed in another file would run on with the old machine code. So the cache lives in a folder named after a
digest of every source file of the package: change any of them, reinstall in place, and the folder is a new one.

Floating point: results hold no NaN (the shell refuses them), the sign of zero carries no meaning, and a
product may be fused with a sum. Sums are never reordered.
"""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, ParamSpec, TypeVar, cast

import numba
from numba.core import config, event

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
            folder.mkdir(parents=True, exist_ok=True, mode=0o700)
            with tempfile.TemporaryFile(dir=folder):
                return folder
        except OSError:
            continue
    return None


_CACHE = _cache_folder()


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile on first call, keep the machine code on disk, release the GIL while running."""
    before = config.CACHE_DIR
    config.CACHE_DIR = str(_CACHE or "")  # Read by Numba when the decorator builds the function's cache.
    try:
        compiled = numba.njit(
            cache=_CACHE is not None,
            nogil=True,
            error_model="numpy",
            fastmath={"nnan", "nsz", "contract"},
        )(function)
    finally:
        config.CACHE_DIR = before
    return cast("Callable[P, R]", compiled)


class _FirstRunNotice(event.Listener):  # type: ignore[misc]
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


event.register("numba:compile", _FirstRunNotice())
