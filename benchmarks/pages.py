"""All pages of this folder, and which of them are older than the kernels that they measure.

    python -m benchmarks.pages             # lists the pages; exits with 1 if one is older
    python -m benchmarks.pages --make      # makes those again, one after the other, which takes hours

A page keeps a digest of the kernels that it measures. It is older if one of these, or a file that they import, has changed
since. What a page measures beside kernels is not compared.
"""

from __future__ import annotations

import re
import subprocess
import sys
from hashlib import sha256
from typing import NamedTuple

from kinseek.kernels.sources import PACKAGE, module_digest

from .command import HERE, ROOT, Command


class Made(NamedTuple):
    """How a page is made."""

    by: str
    """What makes it, as ``python -m`` takes it."""
    rooms: tuple[str, ...]
    """Folders of the kernels that it measures."""


SOLVING = ("atlas", "structure", "branches")
"""Kernels that answer poses."""

PAGES = {
    "black_box.md": Made("benchmarks.black_box", ("grid",)),
    "branches.md": Made("benchmarks.branches", SOLVING),
    "collisions.md": Made("benchmarks.collisions", ("collision",)),
    "field.md": Made("benchmarks.field", SOLVING),
    "fleet.md": Made("benchmarks.fleet", SOLVING),
    "maps.md": Made("benchmarks.maps", ("maps",)),
    "partial_goals.md": Made("benchmarks.partial_goals", SOLVING),
    "paths.md": Made("benchmarks.paths", ("paths", "branches")),
    "paths/scenes.md": Made("benchmarks.paths.scenes", ("paths", "collision")),
    "planning.md": Made("benchmarks.planning", ("collision",)),
    "servoing.md": Made("benchmarks.servoing", ("paths",)),
    "since.md": Made("benchmarks.since", (*SOLVING, "proof", "paths")),
    "speed.md": Made("benchmarks.field --table", SOLVING),
    "streams.md": Made("benchmarks.streams", ("paths", "collision")),
    "suites.md": Made("benchmarks.suites", (*SOLVING, "collision")),
    "trajectories.md": Made("benchmarks.trajectories", ("timing",)),
    "unreachable.md": Made("benchmarks.unreachable", ("atlas", "proof")),
}

GIVEN = {
    "collisions.md": "an arm with meshes, --urdf",
    "paths/scenes.md": "the folders of CppFlow's problems",
    "planning.md": "the folder of its data",
    "since.md": "a commit",
    "suites.md": "the folders of its data",
}
"""Pages whose command takes what nobody can know here."""


def mark(rooms: tuple[str, ...]) -> str:
    """The line of a page from which `state` sees whether the kernels of some folders have changed."""
    files = [path for room in rooms for path in sorted((PACKAGE / "kernels" / room).glob("*.py"))]
    modules = [".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts) for path in files]
    digest = sha256("".join(map(module_digest, modules)).encode()).hexdigest()[:16]
    return f"<!-- kernels {' '.join(rooms)}: {digest} -->"


def mark_of(command: str) -> str:
    """The mark of the page that a command makes, empty if none of `PAGES` is made by it."""
    module = command.split(maxsplit=1)[0]
    return next((mark(made.rooms) for made in PAGES.values() if made.by.split()[0] == module), "")


def state(name: str) -> str:
    """Whether a page is older than its kernels."""
    place = HERE / name
    found = (
        re.search(r"^<!-- kernels .* -->$", place.read_text(encoding="utf-8"), re.M)
        if place.is_file()
        else None
    )
    if found is None:
        return "unknown: made before pages kept a digest" if place.is_file() else "missing"
    return "current" if found[0] == mark(PAGES[name].rooms) else "older than its kernels"


def main() -> None:
    """List the pages, or make them."""
    parser = Command(__file__, __doc__)
    parser.add_argument("--make", action="store_true", help="make the pages that are not current")
    make = parser.parse_args().make
    for name, made in PAGES.items():
        if make and state(name) != "current" and name not in GIVEN:
            subprocess.run([sys.executable, "-m", *made.by.split()], cwd=ROOT, check=False)
        needs = f" (needs {GIVEN[name]})" if name in GIVEN else ""
        print(f"{name:18} {state(name):42} python -m {made.by}{needs}", flush=True)
    sys.exit(any(state(name) != "current" for name in PAGES))


if __name__ == "__main__":
    main()
