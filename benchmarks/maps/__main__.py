"""Maps: what a pose costs, what Dask adds, what is proved, and maps that are sampled beside ours.

Each section says how it measures, and the load of the machine while it did. Times of single threads are CPU times; those of
several processes are wall times too, and need a machine that does nothing else. EAIK judges, so it has to be installed
(`pip install eaik`).

A part that is done is kept in `build/maps`, so what is stopped goes on there; the page is written when all parts are.

    python -m benchmarks.maps                 # writes maps.md beside this folder; some half an hour
    python -m benchmarks.maps --only sampled  # this part anew, and the page if the others are there
    python -m benchmarks.maps --quick         # a minute or two of small numbers, printed and not written
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.command import command, writes
from benchmarks.page import Page
from benchmarks.targets import machine
from kinseek.maps.block import version

from . import certainty, poses, sampled, soundness, workers

HERE = Path(__file__).resolve().parent.parent
KEPT = HERE.parent / "build" / "maps"


def main() -> None:
    """Measure and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("--quick", action="store_true", help="small numbers; nothing is written")
    full: dict[str, Callable[[Page], None]] = {
        "poses": lambda page: poses.measure(page, 1_000_000, rings=True),
        "workers": lambda page: workers.measure(page, 5, 0.0625),
        "soundness": lambda page: soundness.measure(page, 100_000, 100_000),
        "sampled": lambda page: sampled.measure(page, 100_000, 30.0),
        "certainty": lambda page: certainty.measure(page, 12.0),
        "wholes": lambda page: certainty.wholes(page, 40),
        "asked": lambda page: certainty.asked(page, 1_000_000),
    }
    quick: dict[str, Callable[[Page], None]] = {
        "poses": lambda page: poses.measure(page, 20_000, rings=False),
        "workers": lambda page: workers.measure(page, 1, 0.2),
        "soundness": lambda page: soundness.measure(page, 1_600, 400),
        "sampled": lambda page: sampled.measure(page, 5_000, 1.0),
        "certainty": lambda page: certainty.measure(page, 0.5),
        "wholes": lambda page: certainty.wholes(page, 4),
        "asked": lambda page: certainty.asked(page, 100_000),
    }
    parser.add_argument("--only", choices=full, help="one part of the page; all of it unless given")
    writes(parser, "--output", HERE / "maps.md", "the page")
    options = parser.parse_args()
    module = f"benchmarks.maps{' --quick' * options.quick}"
    if options.quick:
        page = Page("Maps", module)
        for name, part in quick.items():
            if options.only in (None, name):
                timed(name, part, page)
        print(page.text)
        return
    for name, part in full.items():
        if name == options.only or (options.only is None and kept(name) is None):
            one = Page("Maps", module)
            timed(name, part, one)
            keep(name, one.body)
    made = {name: kept(name) for name in full}
    missing = [name for name, text in made.items() if text is None]
    if missing:
        print(f"no page yet: {', '.join(missing)} missing", file=sys.stderr)
        return
    page = Page("Maps", module)
    page.say(*[text for text in made.values() if text])
    page.write(options.output)


def timed(name: str, part: Callable[[Page], None], page: Page) -> None:
    """Do a part, and say how long it took."""
    began = time.perf_counter()
    part(page)
    print(f"{name}: {time.perf_counter() - began:.0f} s", file=sys.stderr)


def stamp() -> str:
    """What a part that is kept is of: another version, or another machine, makes it anew."""
    return f"<!-- {version()}, {machine()} -->"


def kept(name: str) -> str | None:
    """A part that is done, or None."""
    path = KEPT / f"{name}.md"
    if not path.exists():
        return None
    first, text = path.read_text(encoding="utf-8").split("\n", 1)
    return text if first == stamp() else None


def keep(name: str, text: str) -> None:
    """Keep a part, whole or not at all."""
    KEPT.mkdir(parents=True, exist_ok=True)
    making = KEPT / f".{name}.md"
    making.write_text(f"{stamp()}\n{text}", encoding="utf-8")
    making.replace(KEPT / f"{name}.md")


if __name__ == "__main__":
    main()
