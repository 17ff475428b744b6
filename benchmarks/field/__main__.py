"""Every solver of inverse kinematics that can be installed, on thirty arms, judged by the forward kinematics of pinocchio.

    pip install -e '.[field]'
    python -m benchmarks.field --quick                        # some five minutes, once the environments exist
    python -m benchmarks.field --table --keep                 # less than eight minutes: all that the README's table needs
    python -m benchmarks.field --half                         # some forty minutes: all arms, half of the targets
    python -m benchmarks.field                                # an hour and a quarter
    python -m benchmarks.field --solvers kinseek ikpy --arms panda ur5e --questions random limits
    python -m benchmarks.field --solvers kinseek ./mine.py    # an adapter of your own, mine.txt beside it
    python -m benchmarks.field --questions unreachable \
        --solvers kinseek eaik ssik benchmarks/field/adapters/kinseek_brief.py    # beside nearest=False
    python -m benchmarks.field --page                         # only write the tables and the page again

Makes an environment for each solver, measures all of them alternately, judges their results, and writes answers.parquet,
pieces.parquet and index.html. Measurements are stored, so an interrupted run continues with the missing ones. docs/field.md
describes the questions, and how to add a solver.
"""

from __future__ import annotations

import json
import time
from argparse import ArgumentTypeError
from pathlib import Path
from typing import Any

from benchmarks.command import ROOT, arm_name, command, writes
from benchmarks.workers.environments import environment, megabytes

from .adapters import SOLVERS, adapter, path_of
from .judge import ARMS, bundled
from .questions import QUESTIONS, SIZES
from .run import Solver, measure, rounds
from .summary import PAGE, SPEED
from .tasks import Field, settings_of


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
    for name, what in (
        ("quick", "two arms and a fifth of the targets"),
        ("table", "what the README's table shows: six arms, two questions"),
        ("half", "half of the targets"),
    ):
        sizes.add_argument(
            f"--{name}",
            dest="size",
            action="store_const",
            const=name,
            help=f"{what}; stored apart from the full run",
        )
    parser.add_argument(
        "--solvers", nargs="+", type=solver_name, default=SOLVERS, help="names, or adapters' files"
    )
    parser.add_argument(
        "--arms",
        nargs="+",
        type=arm_name,
        help="names; by default thirty, two with --quick, six with --table",
    )
    parser.add_argument(
        "--questions", nargs="+", choices=names, metavar="NAME", help=f"of {', '.join(names)}"
    )
    parser.add_argument(
        "--seed", type=int, default=0, help="draws the targets; runs with different seeds are stored apart"
    )
    parser.add_argument(
        "--page", action="store_true", help="measure nothing; write the tables and the page again"
    )
    parser.add_argument(
        "--python",
        action="append",
        type=own_python,
        default=[],
        metavar="SOLVER=PATH",
        help="a Python with a solver that you develop; its packages are not pinned",
    )
    parser.add_argument(
        "--keep",
        action="store_true",
        help=f"write {PAGE.relative_to(ROOT)} and {SPEED.relative_to(ROOT)} too; with --table only the latter",
    )
    writes(parser, "--folder", ROOT / "build" / "field", "where environments, pieces, tables and the page go")
    options = parser.parse_args()
    from .page import write

    size = SIZES[options.size]
    base: Path = options.folder.resolve()
    folder = base / f"{options.size}-{options.seed}"
    folder.mkdir(parents=True, exist_ok=True)
    judges = [bundled(name) for name in options.arms or ARMS[: size.arms]]
    chosen = options.questions or size.questions or names
    asked = [each for each in QUESTIONS if each.name in chosen]
    field = Field(folder, judges, asked, options.seed, size)
    if not options.page:
        run(field, options.solvers, base / "environments", dict(options.python))
    write(field, options.keep)


def run(field: Field, names: list[str], environments: Path, own: dict[str, Path]) -> None:
    """Make the environments, then measure."""
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    console, began, solvers = Console(), time.monotonic(), []
    facts: dict[str, dict[str, Any]] = {}
    columns = BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn()
    with Progress(TextColumn("{task.description}"), *columns, console=console) as progress:
        bar = progress.add_task("", total=len(names))
        for name in names:
            path = path_of(name)
            progress.update(bar, description=f"environment of {path.stem}")
            python = own.get(path.stem) or environment(path, environments)
            module = adapter(path)
            known: dict[str, Any] = {"solver": path.stem, "name": module.NAME, "about": module.__doc__}
            facts[path.stem] = known | {"state": python if isinstance(python, str) else "done"}
            if isinstance(python, str):
                console.print(f"{path.stem}: {python}", highlight=False)
            else:
                size = None if path.stem in own else megabytes(python)
                facts[path.stem] |= {"megabytes": size, "own": path.stem in own}
                solvers.append(Solver(path, module, python, field.folder / f"log-{path.stem}.txt"))
            progress.advance(bar)
        progress.reset(bar, total=rounds(field))

        def advance(what: str, count: int) -> None:
            progress.update(bar, description=what, completed=count)

        best = measure(field, solvers, advance)
        progress.update(bar, completed=rounds(field))
    for solver in solvers:
        name, every = solver.adapter.stem, settings_of(solver.module)
        settings = {"recommended": every["recommended"], "best": every[best[name]]}
        facts[name] |= {"best": best[name], "settings": settings}
    for name, fact in facts.items():
        place = field.folder / "solvers" / f"{name}.json"
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(json.dumps(fact, indent=2), encoding="utf-8")
    console.print(f"measured in {(time.monotonic() - began) / 60:.1f} minutes", highlight=False)


if __name__ == "__main__":
    main()
