"""Every solver of inverse kinematics that can be installed, on thirty arms, judged by one outside forward kinematics.

    pip install -e '.[field]'
    python -m benchmarks.field --quick                        # three minutes, once the environments are there
    python -m benchmarks.field --half                         # half an hour: all arms, half of the targets
    python -m benchmarks.field                                # an hour
    python -m benchmarks.field --solvers kinseek ikpy --arms panda ur5e --questions random limits
    python -m benchmarks.field --solvers kinseek ./mine.py    # an adapter of your own, mine.txt beside it
    python -m benchmarks.field --page                         # the page and the tables anew, of what is measured

Makes an environment for each solver, asks, judges, and writes answers.parquet, pieces.parquet and index.html. What is
measured is kept: a run that was stopped goes on from there. docs/field.md says what is asked, and how to add a solver.
"""

from __future__ import annotations

import json
import time
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any

from benchmarks.command import ROOT, arm_name, command, writes

from .adapters import SOLVERS, adapter, path_of
from .environments import environment, megabytes
from .judge import ARMS, bundled
from .questions import QUESTIONS, SIZES
from .run import measure
from .summary import PAGE
from .tasks import Field, planned


def solver_name(text: str) -> str:
    """A solver that is there, or a file."""
    try:
        adapter(path_of(text))
    except ValueError as error:
        raise ArgumentTypeError(str(error)) from None
    return text


def own_python(text: str) -> tuple[str, Path]:
    """NAME=PATH."""
    name, _, path = text.partition("=")
    if not Path(path).is_file():
        raise ArgumentTypeError(f"{text!r}: expected SOLVER=PATH of a Python that has it")
    return name, Path(path).absolute()


def main() -> None:
    """Measure, and write it down."""
    names = [each.name for each in QUESTIONS]
    parser = command(__file__, __doc__)
    sizes = parser.add_mutually_exclusive_group()
    sizes.set_defaults(size="full")
    for name, what in (("quick", "two arms and a fifth of the targets"), ("half", "half of the targets")):
        sizes.add_argument(
            f"--{name}",
            dest="size",
            action="store_const",
            const=name,
            help=f"{what}; kept apart from the full run",
        )
    parser.add_argument(
        "--solvers", nargs="+", type=solver_name, default=SOLVERS, help="names, or adapters' files"
    )
    parser.add_argument(
        "--arms", nargs="+", type=arm_name, help="names; thirty if it is left out, two with --quick"
    )
    parser.add_argument(
        "--questions", nargs="+", choices=names, metavar="NAME", help=f"of {', '.join(names)}"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="another one draws other targets, and is kept apart"
    )
    parser.add_argument(
        "--page", action="store_true", help="measure nothing, write the tables and the page anew"
    )
    parser.add_argument(
        "--python",
        action="append",
        type=own_python,
        default=[],
        metavar="SOLVER=PATH",
        help="a Python that has a solver, for one that is worked on; then nothing is pinned",
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help=f"write {PAGE.relative_to(ROOT)} too, of which the README's table is made",
    )
    writes(parser, "--folder", ROOT / "build" / "field", "where environments, pieces, tables and the page go")
    options = parser.parse_args()
    from .page import write

    size = SIZES[options.size]
    base: Path = options.folder.resolve()
    folder = base / f"{options.size}-{options.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    judges = [bundled(name) for name in options.arms or ARMS[: size.arms]]
    asked = [each for each in QUESTIONS if options.questions is None or each.name in options.questions]
    field = Field(folder, judges, asked, options.seed, size)
    if not options.page:
        run(field, options.solvers, base / "environments", dict(options.python))
    write(field, PAGE if options.keep else None)


def run(field: Field, solvers: list[str], environments: Path, own: dict[str, Path]) -> None:
    """Environments first, then one solver after the other."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console, began = Console(), time.monotonic()
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        making = progress.add_task("environments", total=len(solvers))
        found = []
        for name in solvers:
            path = path_of(name)
            progress.update(making, description=f"environment of {path.stem}")
            python = own.get(path.stem) or environment(path, environments)
            solver: dict[str, Any] = {
                "solver": path.stem,
                "name": adapter(path).NAME,
                "about": adapter(path).__doc__,
            }
            if isinstance(python, str):
                told(field, solver | {"state": python})
                console.print(f"{path.stem}: {python}", highlight=False)
            else:
                size = None if path.stem in own else megabytes(python)
                found.append(
                    (path, python, solver | {"state": "done", "megabytes": size, "own": path.stem in own})
                )
            progress.advance(making)
        all_of = progress.add_task("", total=sum(planned(field, adapter(path)) for path, _, _ in found))

        def advance(what: str, count: int) -> None:
            progress.update(all_of, description=what, advance=count)

        for path, python, solver in found:
            end = progress.tasks[all_of].completed + planned(field, adapter(path))
            best = measure(field, path, adapter(path), python, advance)
            progress.update(
                all_of, completed=end
            )  # what was planned for other settings, and recommended ones did best
            told(field, solver | {"best": best, "settings": settings(path, best)})
    console.print(f"measured in {(time.monotonic() - began) / 60:.1f} minutes", highlight=False)


def settings(path: Path, best: str) -> dict[str, Any]:
    """What is recommended, and what did best."""
    from .tasks import settings_of

    every = settings_of(adapter(path))
    return {"recommended": every["recommended"], "best": every[best]}


def told(field: Field, solver: dict[str, Any]) -> None:
    """Keep what is known of a solver."""
    place = field.folder / "solvers" / f"{solver['solver']}.json"
    place.parent.mkdir(parents=True, exist_ok=True)
    place.write_text(json.dumps(solver, indent=2), encoding="utf-8")


if __name__ == "__main__":
    main()
