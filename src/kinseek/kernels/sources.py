"""Source files of machine code and their digests: code of another state of the sources must never run."""

from __future__ import annotations

import ast
import functools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

try:
    from _blake2 import blake2b  # `hashlib` has the same, but loads OpenSSL, which takes 3 ms and 4 MB.
except ImportError:
    from hashlib import blake2b

PACKAGE = Path(__file__).resolve().parent.parent


ELSEWHERE = ("solvers/blind_search.py", "solvers/coordinate_descent.py")
"""Files with kernels outside `kernels/`. They are listed because every process needs them before its first solution, and
reading all files takes as long as importing fifty of them."""

ALL = "all"
"""Name that means all folders of kernels."""

EVERYTHING = ("kinseek.kernels.layout",)
"""Modules that generate functions from the declarations of other files."""


def kernel_sources(package: Path = PACKAGE) -> list[Path]:
    """All files whose text machine code depends on: all of `kernels/`, and files that use a decorator of `kernels.jit`.

    A kernel may use nothing of kinseek from any other file; tests/kernels/test_sources.py checks that.
    """
    return [*sorted((package / "kernels").rglob("*.py")), *(package / name for name in ELSEWHERE)]


def is_source(module: str) -> bool:
    """Return True if the file of a module is one of `kernel_sources`."""
    name = module.removeprefix("kinseek.")
    return name.startswith("kernels.") or f"{name.replace('.', '/')}.py" in ELSEWHERE


def source_digest(package: Path = PACKAGE) -> str:
    """Return a digest of `kernel_sources`."""
    return _digest(kernel_sources(package), package)


def room_of(module: str) -> str:
    """Return the folder of a module: a library of kernels may contain only some folders."""
    return module.split(".")[-2]


@functools.cache
def module_digest(module: str, package: Path = PACKAGE) -> str:
    """Return a digest of the sources of a module's kernels: its own, and all that it imports.

    For a module outside kinseek, or one that generates functions, all sources count.

    Args:
        module: Its full name.
        package: The folder of kinseek.
    """
    path = package.parent.joinpath(*module.split(".")).with_suffix(".py")
    if module in EVERYTHING or path not in _imports(package):
        return source_digest(package)
    return _digest(sorted(_closure(path, package)), package)


def _digest(paths: Iterable[Path], package: Path) -> str:
    begin = len(str(package)) + 1
    named = ((str(path)[begin:].replace(os.sep, "/").encode(), path.read_bytes()) for path in paths)
    return digest_of(part for pair in named for part in pair)


def digest_of(parts: Iterable[bytes]) -> str:
    """Return a digest of texts, 16 hexadecimal digits."""
    digest = blake2b(digest_size=8)
    for part in parts:
        digest.update(part)
    return digest.hexdigest()


def _closure(path: Path, package: Path) -> set[Path]:
    """A source and all that it imports, directly or not."""
    found, left = {path}, [path]
    while left:
        new = _imports(package)[left.pop()] - found
        found |= new
        left += new
    return found


@functools.cache
def _imports(package: Path) -> dict[Path, set[Path]]:
    """For each source the sources that it imports directly."""
    sources = set(kernel_sources(package))
    return {path: sources.intersection(_imported(path, package)) for path in sources}


def _imported(path: Path, package: Path) -> Iterator[Path]:
    """Files that an import may refer to: a module, and each name, which may be a module too."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            wholes = [package.parent.joinpath(*each.name.split(".")) for each in node.names]
        elif isinstance(node, ast.ImportFrom):
            above = path.parents[node.level - 1] if node.level else package.parent
            whole = above.joinpath(*(node.module or "").split("."))
            wholes = [whole, *(whole / each.name for each in node.names)]
        else:
            continue
        for whole in wholes:
            yield whole.with_suffix(".py")
            yield whole / "__init__.py"
