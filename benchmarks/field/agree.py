"""Do runs agree? Shares of several, and ratios of times to kinseek, whose 95 % intervals have to meet.

    python -m benchmarks.field --seed 0
    python -m benchmarks.field --seed 1
    python -m benchmarks.field --seed 2
    python -m benchmarks.field.agree build/field/full-0 build/field/full-1 build/field/full-2

Intervals cover what other targets would change. Ends with 1 if more than one in twenty of the shares do not agree.
"""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from benchmarks.command import command

from .tables import ANSWERS, marked, summed

BY = ["solver", "settings", "question"]
MEASURES = ("exact", "ratio")


def apart(runs: list[pd.DataFrame]) -> tuple[dict[str, int], list[str]]:
    """How many intervals of each measure were compared, and which do not meet.

    Args:
        runs: What `summed` makes of each run, by `BY`.
    """
    joined = pd.concat([run.assign(run=number) for number, run in enumerate(runs)])
    compared, told = dict.fromkeys(MEASURES, 0), []
    for key, group in joined.groupby(BY):
        if len(group) < len(runs):
            continue
        for measure in MEASURES:
            compared[measure] += 1
            if group[f"{measure}_low"].max() > group[f"{measure}_high"].min():
                values = ", ".join(f"{value:.4g}" for value in group.sort_values("run")[measure])
                told.append(f"{measure} of {' · '.join(map(str, key))}: {values}")
    return compared, told


def main() -> int:
    """Compare folders."""
    parser = command(__file__, __doc__)
    parser.add_argument("folders", nargs="+", type=Path, help=f"that hold {ANSWERS}")
    folders = parser.parse_args().folders
    missing = [str(folder) for folder in folders if not (folder / ANSWERS).is_file()]
    if missing or len(folders) < 2:
        parser.error(f"nothing measured in {', '.join(missing)}" if missing else "at least two folders")
    compared, told = apart([summed(marked(pd.read_parquet(folder / ANSWERS)), BY) for folder in folders])
    print("\n".join(told))
    for measure, count in compared.items():
        print(f"{measure}: {sum(line.startswith(measure) for line in told)} of {count} do not agree")
    return int(sum(line.startswith("exact") for line in told) > 0.05 * compared["exact"])


if __name__ == "__main__":
    sys.exit(main())
