"""Maps: what a pose costs, what Dask adds, what is proved, and maps that are sampled beside ours.

Each section says how it measures, and the load of the machine while it did. Times of single threads are CPU times; those of
several processes are wall times too, and need a machine that does nothing else. EAIK judges, so it has to be installed
(`pip install eaik`).

    python -m benchmarks.maps                 # writes maps.md beside this folder; some twenty minutes
    python -m benchmarks.maps --quick         # a minute or two of small numbers, printed and not written
    python -m benchmarks.maps --only sampled --output /dev/stdout
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path

from benchmarks.command import command, writes
from benchmarks.page import Page

from . import certainty, poses, sampled, soundness, workers

HERE = Path(__file__).resolve().parent.parent


def main() -> None:
    """Measure and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("--quick", action="store_true", help="small numbers; nothing is written")
    full: dict[str, Callable[[Page], None]] = {
        "poses": lambda page: poses.measure(page, 1_000_000, rings=True),
        "workers": lambda page: workers.measure(page, 2, 0.1),
        "soundness": lambda page: soundness.measure(page, 100_000, 100_000),
        "sampled": lambda page: sampled.measure(page, 100_000, 40.0),
        "certainty": lambda page: certainty.measure(page, ("ur5e",), 60_000, 25.0),
        "asked": lambda page: certainty.asked(page, 1_000_000),
    }
    quick: dict[str, Callable[[Page], None]] = {
        "poses": lambda page: poses.measure(page, 20_000, rings=False),
        "workers": lambda page: workers.measure(page, 1, 0.2),
        "soundness": lambda page: soundness.measure(page, 1_600, 400),
        "sampled": lambda page: sampled.measure(page, 5_000, 1.0),
        "certainty": lambda page: certainty.measure(page, ("ur5e",), 600, 0.5),
        "asked": lambda page: certainty.asked(page, 100_000),
    }
    parser.add_argument("--only", choices=full, help="one part of the page; all of it unless given")
    writes(parser, "--output", HERE / "maps.md", "the page")
    options = parser.parse_args()
    began, page = time.perf_counter(), Page("Maps", f"benchmarks.maps{' --quick' * options.quick}")
    for name, part in (quick if options.quick else full).items():
        if options.only in (None, name):
            part(page)
            print(f"{name}: done after {time.perf_counter() - began:.0f} s", file=sys.stderr)
    if options.quick:
        print(page.text)
    else:
        page.write(options.output)


if __name__ == "__main__":
    main()
