"""kinseek against its peers: the same targets, the same run, each peer from its wheel, one table.

    python -m benchmarks.peers                  # makes the environments, measures, writes benchmarks/peers.md
    python -m benchmarks.peers --arms panda ur5e --targets 300

Every peer answers one pose at a time, on one thread, as called from Python; it is given neither the answer nor anything
near it. An answer counts if plain NumPy forward kinematics finds it within 1e-6 m and 1e-6 rad, and inside the limits.
kinseek is measured again before and after every peer, in several rounds; the ratio is to these.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.command import arm_name, at_least_one, command, writes
from benchmarks.fleet import single_times
from benchmarks.targets import (
    ROBOTS,
    fleet_arm,
    load,
    machine,
    plain_fk,
    random_joints,
    singular_joints,
    strict,
)
from kinseek.robots import catalog_entry
from kinseek.robots.catalog import catalog_path

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
VENVS = HERE / ".venvs"

ENVIRONMENTS = {
    "optik": ("optik-py", "numpy"),
    "shared": ("pin", "EAIK", "ssik", "pytracik", "roboticstoolbox-python"),
}
"""Wheels that share an environment; the others want one each."""

PEERS = {
    "EAIK": ("shared", 2.0),
    "ssik": ("shared", 1.5),
    "Robotics Toolbox": ("shared", 4.0),
    "OptIK": ("optik", 12.0),
    "TRAC-IK": ("shared", 30.0),
    "pinocchio loop": ("shared", None),
}
"""Environment, and how many times faster than it kinseek means to be."""

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


def environment(name: str) -> Path | None:
    """Python of an environment, made if it is not there; None where that fails."""
    folder = VENVS / name
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if (folder / "ready").is_file():
        return python
    print(f"making {folder.name}: {', '.join(ENVIRONMENTS[name])}", flush=True)
    try:
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        subprocess.run(
            [str(python), "-m", "pip", "install", "--quiet", *ENVIRONMENTS[name]], check=True, timeout=900
        )
    except (subprocess.SubprocessError, OSError) as error:
        print(f"  cannot: {error}")
        return None
    (folder / "ready").touch()
    return python


def write_arm(name: str, arm: kinseek.Arm, targets: Array, path: Path) -> None:
    """Write down what a peer may need to know of an arm."""
    chain, n = arm.chain, arm.dof
    square = np.concatenate([chain.fixed, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (n + 1, 1, 1))], axis=1)
    frames = [np.eye(4)]
    for A in square:
        frames.append(frames[-1] @ A)
    points = np.array([frame[:3, 3] for frame in frames])
    urdf = ROBOTS / f"{name}.urdf"
    np.savez(
        path,
        name=name,
        urdf=str(urdf if urdf.is_file() else catalog_path(name)),
        base=catalog_entry(name).base,
        tip=catalog_entry(name).tip,
        joints=np.array(arm.joint_names),
        folder=str(VENVS),
        lower=arm.lower,
        upper=arm.upper,
        fixed=chain.fixed,
        axes=np.array([frame[:3, 2] for frame in frames[1 : n + 1]]),
        offsets=np.diff(points, axis=0),
        turn=frames[-1][:3, :3].T,
        targets=targets,
    )


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
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        destination = Path(folder) / "answers.npz"
        command = [str(python), str(HERE / "worker.py"), peer, str(source), str(destination)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=300, env=os.environ | one, check=False
            )
        except subprocess.TimeoutExpired:
            return "stopped after 300 s", ""
        if done.returncode or not destination.is_file():
            lines = [line for line in done.stderr.strip().splitlines() if line.strip()]
            reason = lines[-1].removeprefix("RuntimeError: ") if lines else f"ended with {done.returncode}"
            return reason[:60], ""
        with np.load(destination) as found:
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
    rows: list[str] = []
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
        print("\n".join(rows[-1 - len(theirs) :]), flush=True)
    minutes = (time.perf_counter() - began) / 60
    options.output.write_text(page(rows, versions, ratios, random, options.rounds, minutes), encoding="utf-8")
    print(f"wrote {options.output}")


def typical(results: list[Result]) -> Result:
    """Medians of every number."""
    columns = zip(
        *((each.median, each.mean, each.p99, each.random, each.singular) for each in results), strict=True
    )
    return Result(*(statistics.median(column) for column in columns))


def line(name: str, who: str, result: Result | str, ratio: float) -> str:
    """One row of the table."""
    if isinstance(result, str):
        return f"| {name} | {who} | – | – | – | – | – | {result} |"
    times = f"{result.median:.1f} | {result.mean:.1f} | {result.p99:.1f}"
    slower = f"{ratio:.1f} ×" if np.isfinite(ratio) else ""
    return f"| {name} | {who} | {times} | {result.random:.1f} | {result.singular:.1f} | {slower} |"


def page(
    rows: list[str],
    versions: dict[str, str],
    ratios: dict[str, list[tuple[float, str]]],
    random: int,
    rounds: int,
    minutes: float,
) -> str:
    """The page as Markdown."""
    used = ", ".join(f"{peer} {release}" for peer, release in versions.items() if release)
    lines = [
        "# Against peers",
        "",
        f"Made by `python -m benchmarks.peers` in {minutes:.0f} minutes. {machine()}. Peers: {used}.",
        f"Load of the machine over the last fifteen minutes: {load()}.",
        "",
        f"{random:,} random reachable targets and {random // 2:,} near singularities and limits, an arm; one pose at a",
        "time, one thread, wall time of the call as made from Python; no seed from the answer. Strict: within 1e-6 m and",
        "1e-6 rad by plain NumPy FK, and inside the limits but for 1e-9 of rounding. Times are of the random targets. The",
        "last column is the peer's median over kinseek's, measured just before and after it; the median of "
        f"{rounds} rounds. Settings: `benchmarks/peers/worker.py`.",
        "",
        "| arm | who | median µs | mean µs | p99 µs | strict % random | strict % near singular | kinseek is faster by |",
        "|---|---|--:|--:|--:|--:|--:|--:|",
        *rows,
        "",
        "| peer | aimed at | median of the arms | least | |",
        "|---|--:|--:|--:|---|",
    ]
    for peer, found in ratios.items():
        aim = PEERS[peer][1]
        if not found:
            lines.append(f"| {peer} | {'' if aim is None else f'{aim:g} ×'} | – | – | not measured |")
            continue
        least, where = min(found)
        middle = statistics.median(ratio for ratio, _ in found)
        verdict = (
            ""
            if aim is None
            else ("met" if least >= aim else "met by the median" if middle >= aim else "missed")
        )
        goal = "" if aim is None else f"{aim:g} ×"
        lines.append(f"| {peer} | {goal} | {middle:.1f} × | {least:.1f} × ({where}) | {verdict} |")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    main()
