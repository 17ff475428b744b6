"""Build the page: the kernels as WebAssembly, the arms, and one HTML file that holds everything.

    python web/build.py                # web/dist/index.html
    python web/build.py --module       # only what the page is made from, in web/build

Needs Numba and ziglang (`pip install 'kinseek[wasm]'`), Node with npm, and the npm registry. The kernels are compiled, for
some minutes, when their sources have changed since the last time.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path

import kinseek
from kinseek.export import to_wasm, wasm_module
from kinseek.kernels.sources import source_digest

HERE = Path(__file__).resolve().parent
BUILD = HERE / "build"
PACKAGE = Path(kinseek.__file__).parent
EXPORT, CATALOG = PACKAGE / "export", PACKAGE / "robots" / "catalog"
PAGE = HERE / "dist" / "index.html"
ARMS = ("ur5e", "panda", "kr6r900", "iiwa14", "puma560", "scara4")
"""Bundled arms that the page shows, in this order."""


def main() -> None:
    """Build what the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--module", action="store_true", help="only what the page is made from, in web/build")
    options = parser.parse_args()
    print(parts())
    if not options.module:
        print(page())


def parts() -> Path:
    """Write kernels and arms for the page into web/build; kernels that are there and up to date stay."""
    BUILD.mkdir(exist_ok=True)
    with _alone():
        return _parts()


@contextlib.contextmanager
def _alone() -> Iterator[None]:
    """Of two that build, the second waits and finds everything done; not on Windows."""
    try:
        import fcntl
    except ImportError:
        yield
        return
    with (BUILD / "lock").open("w") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        yield


def _parts() -> Path:
    files = [EXPORT / name for name in ("compiling.py", "emit.py", "targets.py", "wasm.py", "js/runtime.c")]
    sources = b"".join(each.read_bytes() for each in files)
    digest = hashlib.sha256(source_digest().encode() + sources).hexdigest()[:16]
    stamp, kept = BUILD / "digest", BUILD / "kinseek.wasm"
    fresh = stamp.is_file() and kept.is_file() and stamp.read_text(encoding="utf-8") == digest
    stamp.unlink(missing_ok=True)
    to_wasm([kinseek.load(name) for name in ARMS], BUILD, kept.read_bytes() if fresh else wasm_module(print))
    stamp.write_text(digest, encoding="utf-8")
    about = {name: _about(name) for name in ARMS}
    (BUILD / "about.json").write_text(json.dumps(about), encoding="utf-8")
    return BUILD


def _about(name: str) -> dict[str, str]:
    """What the file of a bundled arm says of itself: what it is, where it comes from, under which licence."""
    lines = (
        (CATALOG / f"{name}.urdf")
        .read_text(encoding="utf-8")
        .partition("<!--")[2]
        .partition("-->")[0]
        .splitlines()
    )
    said = {key: rest for key, _, rest in (line.partition(": ") for line in lines)}
    return {"title": lines[1].partition(" (")[0], "source": said["source"], "licence": said["licence"]}


def page() -> Path:
    """Bundle the page; `parts` must have been written."""
    if not (HERE / "node_modules").is_dir():
        subprocess.run(["npm", "ci", "--no-audit", "--no-fund"], cwd=HERE, check=True)
    subprocess.run(["npm", "run", "--silent", "build"], cwd=HERE, check=True)
    return PAGE


if __name__ == "__main__":
    main()
