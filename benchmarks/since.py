"""Time of calls compared with an earlier commit, arm by arm.

The commit is cloned, its kernels are compiled for this processor, and both versions are measured alternately, each in a
process of its own, so that a change of the machine's speed affects both. Plain NumPy forward kinematics counts the targets
that each has solved, within 1e-6 m and 1e-6 rad and inside the limits.

    python -m benchmarks.since 510bdab
    python -m benchmarks.since HEAD~1 ur5e panda --output since.md
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.kernels.backend import LIBRARY
from kinseek.robots import catalog_entry
from kinseek.robots.catalog import catalog_path

from .command import ROOT, arm_name, at_least_one, command, writes
from .page import Page, percent
from .targets import fleet_names, plain_fk, random_joints, strict
from .workers.process import Gone, Raised, Worker

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
CLONES = HERE / ".since"

ONE, MANY = 200, 2000
"""Poses of a turn, asked one by one and as a batch; the former are the first of the latter."""

QUESTIONS = {"one": ONE, "batch": MANY, "branches": 40, "proof": 10, "path": 200}
"""Kinds of questions, and how many poses of a turn each gets; see `workers.since`."""


PATIENCE = 600.0
"""How long a question may take [s], and what an arm needs before the first."""


@dataclass(frozen=True)
class Row:
    """One arm: of each question the times of a pose [µs] before and now, medians over the turns, and the median ratio."""

    arm: str
    times: dict[str, tuple[float, float, float]]
    solved: tuple[int, int]
    """Targets of the batches, before and now."""


def git(*words: str, folder: Path = ROOT) -> str:
    """What git says."""
    done = subprocess.run(["git", "-C", str(folder), *words], check=True, capture_output=True, text=True)
    return done.stdout.strip()


def earlier(commit: str) -> Path:
    """Sources of a commit, with their library; made if they are not there."""
    folder = CLONES / commit
    if not (folder / "ready").is_file():
        if not folder.is_dir():
            git("clone", "--quiet", "--no-checkout", str(ROOT), str(folder))
        git("checkout", "--quiet", commit, folder=folder)
        if LIBRARY is not None:
            print(f"compiling the kernels of {commit[:7]}", flush=True)
            words = ["native/build.py", "src/kinseek/kernels", "--levels", str(LIBRARY.level)]
            subprocess.run([sys.executable, *words], cwd=folder, check=True)
        (folder / "ready").touch()
    return folder / "src"


def side(source: Path, arm: str, targets: Array, log: Path) -> Worker:
    """A process with the kinseek of a folder and one arm, warm.

    Raises:
        SystemExit: It has another kinseek, or none that runs.
    """
    worker, entry = (
        Worker(Path(sys.executable), "benchmarks.workers.since", log, source=source),
        catalog_entry(arm),
    )
    place = {"file": str(catalog_path(arm)), "base": entry.base, "tip": entry.tip}
    try:
        found = worker.ask("begin", PATIENCE, **place, targets=targets)
    except (Gone, Raised) as why:
        worker.close()
        raise SystemExit(f"the kinseek of {source}: {why}") from None
    if not Path(found).is_relative_to(source):
        worker.close()
        raise SystemExit(f"asked for the kinseek of {source}, got {found}")
    return worker


def measure(name: str, sources: tuple[Path, Path], turns: int, seed: int) -> Row:
    """Measure both on one arm, alternately."""
    arm = kinseek.load(name)
    targets = plain_fk(arm.chain, random_joints(arm.chain, turns * MANY, seed))
    times, q = np.empty((len(QUESTIONS), turns, 2)), np.empty((2, len(targets), arm.dof))
    with tempfile.TemporaryDirectory() as folder:
        sides = [side(source, name, targets, Path(folder) / f"{j}.txt") for j, source in enumerate(sources)]
        for k in range(turns):
            for i, (question, count) in enumerate(QUESTIONS.items()):
                first, last = k * MANY, k * MANY + count
                for j in (0, 1) if k % 2 else (1, 0):
                    found = sides[j].ask("ask", PATIENCE, question=question, first=first, last=last)
                    times[i, k, j] = found["cost"]
                    if question == "batch":
                        q[j, first:last] = found["q"]
        for each in sides:
            each.close()
    before, now = (int(strict(arm.chain, each, targets).sum()) for each in q)
    medians, ratios = np.median(times, axis=1), np.median(times[..., 1] / times[..., 0], axis=1)
    found = {
        question: (float(m[0]), float(m[1]), float(ratio))
        for question, m, ratio in zip(QUESTIONS, medians, ratios, strict=True)
    }
    return Row(name, found, (before, now))


def page(commit: str, rows: list[Row], turns: int) -> Page:
    """The page."""
    page = Page("Since an earlier commit", "benchmarks.since " + commit[:7])
    page.say(
        f"*Before* is the commit {commit[:7]} of {git('log', '-1', '--format=%cs', commit)}. The two states are measured",
        f"alternately, in {turns} rounds. In each round, both solve {ONE} single poses with `arm.ik(T)` from Python (wall",
        f"time). On one thread (processor time) both solve a batch of {MANY:,} poses, find all branches of",
        f"{QUESTIONS['branches']} poses, run {QUESTIONS['proof']} proofs about poses farther away, and follow a path of",
        f"{QUESTIONS['path']} poses. Targets are poses of joint values uniform inside the limits. Times are medians over",
        "the rounds [µs a pose]; ratios are medians of the ratios of the rounds, so they differ from the quotients of the",
        "times. *Solved* is the share of the batches that is within 1e-6 m and 1e-6 rad by plain NumPy forward",
        "kinematics, and inside the limits.",
    )
    cells = [
        (
            row.arm,
            *(cell for each in row.times.values() for cell in times(each)),
            *(percent(n, turns * MANY) for n in row.solved),
        )
        for row in rows
    ]
    medians = [np.median([row.times[question] for row in rows], axis=0) for question in QUESTIONS]
    cells.append((f"median of {len(rows)}", *(cell for each in medians for cell in times(each)), "", ""))
    heads = " | ".join(f">{question} before | >now | >ratio" for question in QUESTIONS)
    page.table(f"arm | {heads} | >solved before % | >now %", cells)
    return page


def times(some: Iterable[float]) -> tuple[str, str, str]:
    """Before, now [µs], and the ratio."""
    before, now, ratio = some
    digits = 2 if before < 10.0 else 1 if before < 100.0 else 0
    return f"{before:,.{digits}f}", f"{now:,.{digits}f}", f"{ratio:.2f} ×"


def main() -> None:
    """Run it and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("commit", help="what is compared with, as git names it")
    parser.add_argument("arms", nargs="*", type=arm_name, help="names; the fleet by default")
    parser.add_argument("--turns", type=at_least_one, default=15, help="of each side and arm")
    parser.add_argument("--seed", type=int, default=3)
    writes(parser, "--output", HERE / "since.md", "where the page goes")
    options = parser.parse_args()
    try:
        commit = git("rev-parse", "--verify", "--quiet", "--end-of-options", options.commit + "^{commit}")
    except subprocess.CalledProcessError:
        parser.error(f"no commit {options.commit!r} in this repository")
    sources = earlier(commit), ROOT / "src"
    rows = []
    for name in options.arms or fleet_names():
        rows.append(row := measure(name, sources, options.turns, options.seed))
        report = ", ".join(
            f"{question} {' -> '.join(times(each)[:2])} µs ({times(each)[2]})"
            for question, each in row.times.items()
        )
        print(f"{name:18s} {report}, solved {row.solved[0]:,} -> {row.solved[1]:,}", flush=True)
    page(commit, rows, options.turns).write(options.output)


if __name__ == "__main__":
    main()
