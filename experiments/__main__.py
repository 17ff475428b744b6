"""Run the experiments: ``python -m experiments [NAME ...] [--quick] [--out FOLDER] [--force]``."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from .effort import EXPERIMENTS, Effort, Experiment, experiment
from .store import ExperimentError, Store, key_of

HERE = Path(__file__).resolve().parent
RESULTS = HERE / "results"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the requested experiments; return 0, or 2 for a mistake in the call, or 130 if interrupted."""
    asked = parser().parse_args(arguments)
    try:
        names = chosen(asked.names)
        if names == ["claims"]:
            from .claims import rewrite
            from .judges import Results

            rewrite(Results(asked.out or RESULTS), asked.pages)
            return 0
        effort = Effort(quick=asked.quick, seed=asked.seed)
        # A quick run must not replace the full results that the repository keeps.
        folder = asked.out or (HERE / "results-quick" if asked.quick else RESULTS)
        if find_spec("matplotlib") is None:  # Asked before hours are spent.
            raise ExperimentError("matplotlib is missing: pip install 'kinseek[experiments]'")
        try:
            run_all(names, effort, folder, force=asked.force, redraw=asked.redraw)
        except OSError as error:
            why = f"cannot write to {folder}: {error.strerror or error}. Choose another folder with --out"
            raise ExperimentError(why) from error
    except ExperimentError as error:
        print(f"experiments: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print(
            "\nexperiments: interrupted. Finished rows are kept; the same command goes on from there.",
            file=sys.stderr,
        )
        return 130
    return 0


def parser() -> argparse.ArgumentParser:
    """The command line."""
    made = argparse.ArgumentParser(
        "python -m experiments", description="Run the paper's Section 4 again.", allow_abbrev=False
    )
    made.add_argument(
        "names", nargs="*", metavar="NAME", help=f"{', '.join(EXPERIMENTS)}; or claims; default all"
    )
    made.add_argument(
        "--quick",
        action="store_true",
        help="few points and cases: a minute for everything, and a minute more to compile",
    )
    made.add_argument(
        "--out",
        type=Path,
        help="folder of the results; experiments/results if it is left out, or results-quick with --quick",
    )
    made.add_argument(
        "--pages",
        type=Path,
        default=HERE.parent,
        help="folder below which claims writes its pages; the repository if it is left out",
    )
    made.add_argument("--seed", type=int, default=0, help="seed of the random points")
    made.add_argument("--force", action="store_true", help="run finished experiments again")
    made.add_argument("--redraw", action="store_true", help="only draw the pictures again, from the CSVs")
    return made


def chosen(names: Sequence[str]) -> list[str]:
    """The experiments to run.

    Raises:
        ExperimentError: A name that is none.
    """
    if list(names) == ["claims"]:
        return ["claims"]
    unknown = [name for name in names if name not in EXPERIMENTS]
    if unknown:
        raise ExperimentError(
            f"unknown experiment {', '.join(unknown)}. Valid: {', '.join(EXPERIMENTS)}; or claims alone"
        )
    return [name for name in EXPERIMENTS if not names or name in names]


def run_all(
    names: Sequence[str], effort: Effort, folder: Path, *, force: bool = False, redraw: bool = False
) -> None:
    """Run experiments one after the other, each into its own three files, and say what goes on."""
    begun = time.perf_counter()
    for number, name in enumerate(names, start=1):
        module, store, start = experiment(name), Store(folder, name), time.perf_counter()
        if redraw:
            draw(module, store)
        elif store.finished(effort) and not force:
            print(f"{name}: finished already (--force runs it again)")
            if not store.picture.exists():
                draw(module, store)
        else:
            # At once, so that a log shows it while the work goes on.
            print(f"{number}/{len(names)} {name}: {summary(module)} ...", flush=True)
            run(module, store, effort)
            draw(module, store)
            count, took = len(module.cases(effort)), time.perf_counter() - start
            print(f"    {count} rows in {took:.1f} s -> {store.picture}", flush=True)
    print(f"all in {time.perf_counter() - begun:.0f} s, in {folder}")


def summary(module: Experiment) -> str:
    """The first line of an experiment's docstring, without its name."""
    return (module.__doc__ or "").partition("\n")[0].partition(": ")[2].rstrip(".")


def run(module: Experiment, store: Store, effort: Effort) -> None:
    """Measure what is missing, row by row, and give the rows their final name once all are there."""
    cases = list(module.cases(effort))
    keys = tuple(cases[0])
    done = {key_of(row, keys) for row in store.begin(effort)}
    start = time.perf_counter()
    for case in (case for case in cases if key_of(case, keys) not in done):
        store.append({**case, **module.measure(case, effort)})
    store.finish(effort, cases, time.perf_counter() - start)


def draw(module: Experiment, store: Store) -> None:
    """Draw the picture from the CSV.

    Raises:
        ExperimentError: There is no CSV yet.
    """
    if not store.csv.exists():
        raise ExperimentError(
            f"{store.name} has not been run: there is no {store.csv.name} in {store.folder}"
        )
    module.draw(store.rows(module.cases(Effort())[0]), store.picture)


if __name__ == "__main__":
    sys.exit(main())
