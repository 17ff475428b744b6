"""kinseek against its peers: the same targets, the same run, each peer from its wheel, one table.

    python -m benchmarks.peers                  # makes the environments, measures, writes benchmarks/peers.md
    python -m benchmarks.peers --arms panda ur5e --targets 300

Every peer answers one pose at a time, on one thread, as called from Python; it is given neither the answer nor anything
near it. An answer counts if plain NumPy forward kinematics finds it within 1e-6 m and 1e-6 rad, and inside the limits.
kinseek is measured again before and after every peer, in several rounds; the ratio is to these.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.command import arm_name, at_least_one, command, writes
from benchmarks.fleet import single_times
from benchmarks.page import Page, row_of
from benchmarks.targets import fleet_arm, plain_fk, random_joints, singular_joints, strict

from .environments import HERE, PEERS, VENVS, ask, environment, releases, write_arm

Array = NDArray[np.float64]

ARMS = ("panda", "ur5e", "iiwa14", "irb120", "kr6r900", "puma560")


@dataclass(frozen=True)
class Result:
    """One peer, or kinseek, on one arm."""

    median: float
    """[µs]"""
    mean: float
    """[µs]"""
    p99: float
    """[µs]"""
    random: float
    """Strict, random targets [%]."""
    singular: float
    """Strict, near singularities and limits [%]."""


def summary(arm: kinseek.Arm, q: Array, times: Array, targets: Array, random: int) -> Result:
    """Judge answers, (k, n), the first `random` of them to random targets, by plain FK."""
    good = strict(arm.chain, q, targets, slack=1e-9)
    loose = times[:random]
    return Result(
        float(np.median(loose)),
        float(loose.mean()),
        float(np.percentile(loose, 99)),
        100 * float(good[:random].mean()),
        100 * float(good[random:].mean()),
    )


def measure_kinseek(arm: kinseek.Arm, targets: Array, random: int) -> Result:
    """Call `arm.ik` pose by pose."""
    single_times(arm, targets[:200])
    times = single_times(arm, targets)
    return summary(arm, np.array([arm.ik(T).q for T in targets]), times, targets, random)


def measure_peer(
    peer: str, python: Path, arm: kinseek.Arm, source: Path, targets: Array, random: int
) -> tuple[Result | str, str]:
    """Run a peer in its environment; return what it does, or why there is nothing, and its version."""
    found = ask("worker.py", peer, python, source, 300)
    if isinstance(found, str):
        return found, ""
    return summary(arm, found["q"], found["times"], targets, random), str(found["version"])


def main() -> None:
    """Measure every arm with every peer and write the table."""
    parser = command(__file__, __doc__)
    parser.add_argument("--arms", nargs="+", type=arm_name, default=ARMS, help="names")
    parser.add_argument("--peers", nargs="+", default=list(PEERS), choices=list(PEERS), help="names")
    parser.add_argument(
        "--targets", type=at_least_one, default=1000, help="random targets an arm; half as many near singular"
    )
    parser.add_argument(
        "--rounds", type=at_least_one, default=3, help="times that every peer is measured; medians count"
    )
    writes(parser, "--output", HERE.parent / "peers.md", "page to write")
    options = parser.parse_args()
    VENVS.mkdir(exist_ok=True)
    pythons = {name: environment(name) for name in {PEERS[peer][0] for peer in options.peers}}
    began, random = time.perf_counter(), options.targets
    rows: list[tuple[str, ...]] = []
    versions: dict[str, str] = {}
    ratios: dict[str, list[tuple[float, str]]] = {peer: [] for peer in options.peers}
    for name in options.arms:
        arm = fleet_arm(name)
        q = np.concatenate([random_joints(arm.chain, random, 0), singular_joints(arm.chain, random // 2, 0)])
        targets = plain_fk(arm.chain, q)
        ours = [measure_kinseek(arm, targets, random)]
        theirs: dict[str, list[tuple[Result, float]]] = {peer: [] for peer in options.peers}
        reasons: dict[str, str] = {}
        with tempfile.TemporaryDirectory() as folder:
            source = Path(folder) / "arm.npz"
            write_arm(name, arm, targets, source)
            for turn in range(options.rounds):
                for peer in options.peers:
                    python = pythons[PEERS[peer][0]]
                    if python is None:
                        reasons[peer] = "could not be installed"
                    if peer in reasons or (turn and PEERS[peer][1] is None):
                        continue
                    before = measure_kinseek(arm, targets, random)
                    result, release = measure_peer(peer, python or Path(), arm, source, targets, random)
                    if isinstance(result, str):
                        reasons[peer] = result
                        continue
                    after = measure_kinseek(arm, targets, random)
                    versions[peer] = release
                    ours += [before, after]
                    theirs[peer].append((result, 2 * result.median / (before.median + after.median)))
        rows.append(line(name, "**kinseek**", typical(ours), np.nan))
        for peer, found in theirs.items():
            if not found:
                rows.append(line(name, peer, reasons[peer], np.nan))
                continue
            ratio = statistics.median(each for _, each in found)
            rows.append(line(name, peer, typical([result for result, _ in found]), ratio))
            ratios[peer].append((ratio, name))
        print("\n".join(map(row_of, rows[-1 - len(theirs) :])), flush=True)
    minutes = (time.perf_counter() - began) / 60
    page(rows, versions, ratios, random, options.rounds, minutes).write(options.output)


def typical(results: list[Result]) -> Result:
    """Medians of every number."""
    columns = zip(
        *((each.median, each.mean, each.p99, each.random, each.singular) for each in results), strict=True
    )
    return Result(*(statistics.median(column) for column in columns))


def line(name: str, who: str, result: Result | str, ratio: float) -> tuple[str, ...]:
    """One row of the table."""
    if isinstance(result, str):
        return (name, who, *"–" * 5, result)
    numbers = result.median, result.mean, result.p99, result.random, result.singular
    slower = f"{ratio:.1f} ×" if np.isfinite(ratio) else ""
    return (name, who, *(f"{number:.1f}" for number in numbers), slower)


def page(
    rows: list[tuple[str, ...]],
    versions: dict[str, str],
    ratios: dict[str, list[tuple[float, str]]],
    random: int,
    rounds: int,
    minutes: float,
) -> Page:
    """The page."""
    page = Page("Against peers", "benchmarks.peers", minutes, releases(versions))
    page.say(
        f"{random:,} random reachable targets and {random // 2:,} near singularities and limits, an arm; one pose at a",
        "time, one thread, wall time of the call as made from Python; no seed from the answer. Strict: within 1e-6 m and",
        "1e-6 rad by plain NumPy FK, and inside the limits but for 1e-9 of rounding. Times are of the random targets. The",
        "last column is the peer's median over kinseek's, measured just before and after it; the median of "
        f"{rounds} rounds. Settings: `benchmarks/peers/worker.py`.",
    )
    page.table(
        "arm | who | >median µs | >mean µs | >p99 µs | >strict % random | >strict % near singular | >kinseek is faster by",
        rows,
    )
    page.table(
        "peer | >aimed at | >median of the arms | >least |",
        [aimed(peer, PEERS[peer][1], found) for peer, found in ratios.items()],
    )
    return page


def aimed(peer: str, aim: float | None, found: list[tuple[float, str]]) -> tuple[str, ...]:
    """One row of the table of what is aimed at: the ratios found, and on which arm."""
    wanted = "" if aim is None else f"{aim:g} ×"
    if not found:
        return peer, wanted, "–", "–", "not measured"
    least, where = min(found)
    middle = statistics.median(ratio for ratio, _ in found)
    found_here = peer, wanted, f"{middle:.1f} ×", f"{least:.1f} × ({where})"
    if aim is None:
        return (*found_here, "")
    return (*found_here, "met" if least >= aim else "met by the median" if middle >= aim else "missed")


if __name__ == "__main__":
    main()
