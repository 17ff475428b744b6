"""Time of calls compared with an earlier commit, arm by arm.

The commit is cloned, its kernels are compiled for this processor, and both versions are measured alternately, each in a
process of its own, so that a change of the machine's speed affects both. In each of some rounds, both solve 200 single poses
with `arm.ik(T)` from Python (wall time). On one thread (processor time) both solve a batch of 2,000 poses, find all branches
of 40 poses, run 10 proofs about poses farther away, and follow a path of 200 poses. Targets are poses of joint values
uniform inside the limits. Times are medians over the rounds [µs a pose]. A ratio is the time now divided by the time before,
the median over the rounds, so it differs from the quotient of the two medians. *Solved* is the share of the batches that is
within 1e-6 m and 1e-6 rad by plain NumPy forward kinematics, and inside the limits.

    python -m benchmarks.since 510bdab
    python -m benchmarks.since HEAD~1 ur5e panda --output since.md
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

import kinseek
from kinseek.kernels.backend import LIBRARY
from kinseek.robots import catalog_entry
from kinseek.robots.catalog import catalog_path

from .command import HERE, ROOT, command
from .page import Page, Row, share
from .targets import Array, plain_fk, random_joints, strict
from .workers.process import Gone, Raised, Worker

CLONES = HERE / ".since"

ONE, MANY = 200, 2000
"""Poses of a turn, asked one by one and as a batch; the former are the first of the latter."""

QUESTIONS = {"one": ONE, "batch": MANY, "branches": 40, "proof": 10, "path": 200}
"""Kinds of questions, and how many poses of a turn each gets; see `workers.since`."""


PATIENCE = 600.0
"""How long a question may take [s], and what an arm needs before the first."""


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
    worker = Worker(Path(sys.executable), "benchmarks.workers.since", log, source=source)
    entry = catalog_entry(arm)
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


def measure(name: str, sources: tuple[Path, Path], turns: int, seed: int) -> tuple[Array, tuple[int, int]]:
    """Measure both on one arm, alternately.

    Returns:
        Of each question the times of a pose [µs] before and now, medians over the turns, and the median ratio,
        (questions, 3); and how many targets of the batches were solved, before and now.
    """
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
    ratios = np.median(times[..., 1] / times[..., 0], axis=1)
    return np.column_stack([np.median(times, axis=1), ratios]), (before, now)


def row(name: str, times: Array, *solved: str) -> Row:
    """A line of the table."""
    cells: Row = {"arm": name}
    for question, (before, now, ratio) in zip(QUESTIONS, times, strict=True):
        digits = 2 if before < 10.0 else 1 if before < 100.0 else 0
        cells[f">{question} before"] = f"{before:,.{digits}f}"
        cells[f">{question} now"], cells[f">{question} ratio"] = f"{now:,.{digits}f}", f"{ratio:.2f} ×"
    return cells | dict(zip((">solved before %", ">solved now %"), solved, strict=True))


def compared(names: Sequence[str], sources: tuple[Path, Path], turns: int, seed: int) -> Iterator[Row]:
    """A line of each arm, and one of their medians."""
    every = []
    for name in names:
        times, solved = measure(name, sources, turns, seed)
        every.append(times)
        yield row(name, times, *(share(n / (turns * MANY)) for n in solved))
    yield row(f"median of {len(every)}", np.median(every, axis=0), "", "")


def main() -> None:
    """Run it and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("commit", help="what is compared with, as git names it")
    parser.ask((), "since.md", {"turns": (15, 1, "of each side and arm")})
    parser.add_argument("--seed", type=int, default=3)
    options = parser.options()
    try:
        commit = git("rev-parse", "--verify", "--quiet", "--end-of-options", options.commit + "^{commit}")
    except subprocess.CalledProcessError:
        parser.error(f"no commit {options.commit!r} in this repository")
    sources = earlier(commit), ROOT / "src"
    page = Page("Since an earlier commit", f"benchmarks.since {commit[:7]}", __doc__)
    page.say(f"*Before* is the commit of {git('log', '-1', '--format=%cs', commit)}; {options.turns} rounds.")
    page.rows(compared(options.arms, sources, options.turns, options.seed))
    page.end(options)


if __name__ == "__main__":
    main()
