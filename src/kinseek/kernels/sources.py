"""Which files machine code is made from, and a digest of them: code of another state of the sources must never run."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


ELSEWHERE = ("solvers/blind_search.py", "solvers/coordinate_descent.py")
"""Files with kernels outside `kernels/`. They are named: every process asks before its first answer, and to look into all
files takes as long as to import fifty of them."""


def kernel_sources(package: Path = PACKAGE) -> list[Path]:
    """Every file whose text machine code depends on: all of `kernels/`, and what takes a decorator from `kernels.jit`.

    A kernel may use nothing of ours from any other file; tests/test_jit_cache.py looks.
    """
    return [*sorted((package / "kernels").rglob("*.py")), *(package / name for name in ELSEWHERE)]


def source_digest(package: Path = PACKAGE) -> str:
    """Return a digest of `kernel_sources`."""
    digest, begin = hashlib.sha256(), len(str(package)) + 1
    for path in kernel_sources(package):
        digest.update(str(path)[begin:].replace(os.sep, "/").encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
