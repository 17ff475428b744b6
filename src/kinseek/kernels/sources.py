"""Which files machine code is made from, and a digest of them: code of another state of the sources must never run."""

from __future__ import annotations

import hashlib
from pathlib import Path

PACKAGE = Path(__file__).resolve().parent.parent


def kernel_sources(package: Path = PACKAGE) -> list[Path]:
    """Every file whose text machine code depends on: all of `kernels/`, and what takes a decorator from `kernels.jit`.

    A kernel may use nothing of ours from any other file; tests/test_jit_cache.py looks.
    """
    kernels = package / "kernels"
    return [
        path
        for path in sorted(package.rglob("*.py"))
        if path.is_relative_to(kernels) or b"kernels.jit import" in path.read_bytes()
    ]


def source_digest(package: Path = PACKAGE) -> str:
    """Return a digest of `kernel_sources`."""
    digest = hashlib.sha256()
    for path in kernel_sources(package):
        digest.update(path.relative_to(package).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
