"""Maps: what a pose costs, what Dask adds, what is proved, and maps that are sampled beside ours.

Each section says how it measures, and the load of the machine while it did. Times of single threads are CPU times; those of
several processes are wall times too, and need a machine that does nothing else. EAIK judges, so it has to be installed
(`pip install eaik`).

    python -m benchmarks.maps                 # writes maps.md beside this folder; some half an hour
    python -m benchmarks.maps --only sampled  # this part anew, and the page if the others are there
    python -m benchmarks.maps --quick         # a minute or two of small numbers, printed and not written
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from benchmarks.command import command
from benchmarks.page import Page, Part, in_parts

from . import certainty, poses, sampled, soundness, workers


def sized(
    measure: Callable[..., None], full: tuple[float | bool, ...], quick: tuple[float | bool, ...]
) -> Part:
    """A part that is measured with some numbers, or with small ones."""

    def part(page: Page, options: argparse.Namespace) -> None:
        measure(page, *(quick if options.quick else full))

    return part


PARTS = {
    "poses": sized(poses.measure, (1_000_000, True), (20_000, False)),
    "workers": sized(workers.measure, (5, 0.0625), (1, 0.2)),
    "soundness": sized(soundness.measure, (100_000, 100_000), (1_600, 400)),
    "sampled": sized(sampled.measure, (100_000, 30.0), (5_000, 1.0)),
    "certainty": sized(certainty.measure, (12.0,), (0.5,)),
    "wholes": sized(certainty.wholes, (40,), (4,)),
    "asked": sized(certainty.asked, (1_000_000,), (100_000,)),
}


def main() -> None:
    """Measure and write the page."""
    parser = command(__file__, __doc__, page="maps.md")
    parser.add_argument("--only", nargs="*", choices=PARTS, default=(), help="parts; all of them by default")
    in_parts("Maps", "benchmarks.maps", __doc__, PARTS, parser.options())


if __name__ == "__main__":
    main()
