"""An environment for each solver, made of the requirements that stand beside its adapter, every version pinned."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

from benchmarks.command import ROOT


def digest(*parts: bytes | str) -> str:
    """Of some texts or files, short."""
    whole = hashlib.sha256()
    for part in parts:
        whole.update(part.encode() if isinstance(part, str) else part)
        whole.update(b"\0")
    return whole.hexdigest()[:16]


@cache
def required(adapter: Path) -> str:
    """Digest of what a solver is installed from: its requirements, and the sources of this repository if it is one."""
    requirements = adapter.with_suffix(".txt")
    if not requirements.is_file():
        return ""
    text = requirements.read_bytes()
    own = [path for path in sorted(ROOT.glob("src/**/*.py")) if HERE in text.split()]
    return digest(text, *(path.read_bytes() for path in own))


ENVIRONMENTS = ROOT / "build" / "field" / "environments"

HERE = b"."
"""This repository, in a file of requirements."""


def environment(adapter: Path, folder: Path = ENVIRONMENTS) -> Path | str:
    """Python of a solver's environment, made again if its requirements have changed; or why there is none.

    Args:
        adapter: Its file; the requirements have the same name and end in .txt.
        folder: Where environments are kept.
    """
    requirements = adapter.with_suffix(".txt")
    if not requirements.is_file():
        return f"no {requirements.name} beside {adapter.name}"
    place = folder / adapter.stem
    python = place / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    ready, wanted = place / "ready", required(adapter)
    if ready.is_file() and ready.read_text(encoding="ascii") == wanted:
        return python
    uv = [sys.executable, "-m", "uv"]
    install = ["pip", "install", "--compile-bytecode", "--refresh-package", "kinseek"]
    install += ["--python", str(python), "--requirement", str(requirements)]
    for command in (["venv", "--clear", "--python", sys.executable, str(place)], install):
        try:
            done = subprocess.run(
                [*uv, "--quiet", *command],
                capture_output=True,
                text=True,
                cwd=ROOT,
                timeout=1800,
                check=False,
            )
        except (subprocess.TimeoutExpired, OSError) as error:
            return f"could not be installed: {error}"
        if done.returncode:
            why = (
                " ".join(word for word in done.stderr.split() if word.isascii())
                or f"uv ended with {done.returncode}"
            )
            return f"could not be installed: {why[:300]}"
    ready.write_text(wanted, encoding="ascii")
    return python


def megabytes(python: Path, without: tuple[str, ...] = ()) -> float:
    """What an environment's packages take on disk, dependencies included [MB]; not those whose names begin so."""
    command = [str(python), "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"]
    folder = Path(subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip())
    files = (path for path in folder.rglob("*") if path.is_file() and not path.is_symlink())
    counted = (path for path in files if not path.relative_to(folder).parts[0].startswith(without))
    return sum(path.stat().st_size for path in counted) / 1e6
