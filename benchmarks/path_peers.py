"""kinseek and its peers on paths: the same tasks, the same run, each peer from its wheel, one judge.

Tasks are lines of 0.4 m and circles of 0.15 m with 500 poses, and rasters of 2,000 poses with a free turn about the tool
axis, placed so that every pose can be reached. kinseek gets no start. A peer that goes from pose to pose gets the joint
values that made the task. A path is followed if plain NumPy forward kinematics confirms every pose within 1e-4 m and 1e-3
rad, inside the limits, and no joint moves 0.2 rad or farther between two poses. Times are processor times, which other
processes affect less.

Tasks that kinseek does not follow are listed with the reason, and every peer tries them again from eight starts. For arms
with one redundant joint the page also says how far any solution leads: all solutions of every pose over a grid of the last
joint, where each continues from those of the pose before that are within a step.

A cell (one peer on one kind of task of one arm) is written to path_peers.csv as soon as it is measured. An interrupted run
continues from there; `--again` measures again.

    python -m benchmarks.path_peers                      # makes the environments, measures, writes path_peers.md
    python -m benchmarks.path_peers --again kinseek pink
    python -m benchmarks.path_peers --quick              # two placements each, printed and not kept
"""

from __future__ import annotations

import csv
import tempfile
import time
import urllib.request
from dataclasses import asdict, dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek

from .command import at_least_one, command, writes
from .field.adapters import path_of
from .field.judge import bundled
from .page import Page
from .paths import LARGEST, TASK_ARMS, asked, placement
from .targets import plain_fk, pose_errors
from .workers.motion import FOLLOWERS
from .workers.process import called, releases

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

KINDS = ("line", "circle", "raster")

PLACE, TURN = 1e-4, 1e-3
"""Within which a pose counts [m], [rad]."""

STARTS, SECONDS = 8, 540
"""Starts for what kinseek missed, and time for one cell [s]: what is not done by then is not counted."""

GRID = 120
"""Values of the last joint over which all answers are found."""

IKLINK = "https://raw.githubusercontent.com/uwgraphics/IKLink/HEAD/"
"""Wang, Sifferman and Gleicher 2024, *IKLink*, MIT licence; read when this runs, not kept here."""

IKLINK_FILES = ("configs/urdfs/panda.urdf", "input_trajectories/panda_2023-08-25_11-37-55.csv")
"""Its Panda, and the demonstration."""


@dataclass(frozen=True)
class Cell:
    """One peer, or kinseek, on one kind of task of one arm."""

    arm: str
    kind: str
    who: str
    placements: int
    tried: int
    """Placements it came to in its time."""
    followed: int
    travels: str
    """Length of the way of the joints at each placement [rad], 0 where it was not followed."""
    cost: float
    """[µs] a waypoint, median."""
    note: str
    """Why there is nothing, or what is to be said."""
    release: str

    @property
    def key(self) -> tuple[str, str, str, int]:
        """What it is about."""
        return self.arm, self.kind, self.who, self.placements

    @property
    def lengths(self) -> Array:
        """`travels` as numbers, (placements,); none if nothing was measured."""
        return np.array(self.travels.split(), dtype=float)


def tasks(arm: kinseek.Arm, kind: str, count: int) -> tuple[Array, Array]:
    """Paths, (count, N, 4, 4), and the joint values that made each, (count, n)."""
    rng = np.random.default_rng(7)
    found = [placement(arm, kind, rng) for _ in range(count)]
    return np.array([T for T, _ in found]), np.array([q for _, q in found])


def followed(arm: kinseek.Arm, kind: str, q: Array, T: Array) -> bool:
    """Is a path, (N, n), followed? By plain forward kinematics, which shares nothing with whom it judges."""
    if not np.isfinite(q).all():
        return False
    found = plain_fk(arm.chain, q)
    place, turn = pose_errors(found, T)
    if kind == "raster":
        turn = np.arctan2(
            np.linalg.norm(np.cross(found[:, :3, 2], T[:, :3, 2]), axis=1),
            (found[:, :3, 2] * T[:, :3, 2]).sum(axis=1),
        )
    within = ((q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9)).all()
    small = np.abs(np.diff(q, axis=0)).max() < LARGEST
    return bool(within and small and (place <= PLACE).all() and (turn <= TURN).all())


def summary(
    arm: kinseek.Arm,
    kind: str,
    who: str,
    found: list[tuple[Array, Array, float]],
    placements: int,
    release: str,
) -> Cell:
    """Judge paths, given as joint values, poses, and time of a waypoint [µs]; NaN is the time of what was not tried."""
    good = [followed(arm, kind, q, T) for q, T, _ in found]
    tried = [bool(np.isfinite(cost)) for _, _, cost in found]
    travels = [
        float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum()) if one else 0.0
        for (q, _, _), one in zip(found, good, strict=True)
    ]
    return Cell(
        arm=arm.name,
        kind=kind,
        who=who,
        placements=placements,
        tried=sum(tried),
        followed=sum(good),
        travels=" ".join(f"{travel:.4f}" for travel in travels),
        cost=float(np.nanmedian([cost for _, _, cost in found])) if any(tried) else np.nan,
        note="",
        release=release,
    )


def measure_kinseek(arm: kinseek.Arm, kind: str, paths: Array) -> tuple[Cell, dict[int, str]]:
    """Follow every path from no start; the cell, and why each that was missed was missed."""
    arm.follow(asked(kind, paths[0][:40]), threads=1)
    found, reasons = [], {}
    for i, T in enumerate(paths):
        began = time.process_time()
        path = arm.follow(asked(kind, T), max_step=LARGEST * (1 - 1e-9), threads=1)
        found.append((path.q, T, (time.process_time() - began) / len(T) * 1e6))
        if not path.success:
            reasons[i] = "; ".join(path.why[:3]) or str(path.status)
    cell = summary(arm, kind, "kinseek", found, len(paths), kinseek.__version__)
    for i in np.flatnonzero(cell.lengths == 0.0).tolist():
        reasons.setdefault(i, "said to be followed, and is not by plain forward kinematics")
    return cell, reasons


def measure_peer(arm: kinseek.Arm, kind: str, peer: str, paths: Array, starts: Array, seconds: int) -> Cell:
    """Let a peer follow every path, from one start after another."""
    place = path_of(FOLLOWERS[peer][0]), "benchmarks.workers.motion", "follow", seconds + 300
    asked = {"peer": peer, "arm": asdict(bundled(arm.name).arm), "paths": paths, "starts": starts}
    found = called(*place, **asked, free=kind == "raster", seconds=seconds)
    if isinstance(found, str):
        return Cell(arm.name, kind, peer, len(paths), 0, 0, "", np.nan, found, "")
    rows = list(zip(np.array(found["q"]), paths, map(float, found["times"]), strict=True))
    return summary(arm, kind, peer, rows, len(paths), found["version"])


def eight_starts(arm: kinseek.Arm, T: Array, q0: Array) -> Array:
    """The joint values that made a task and seven other answers to its first pose, far from one another, (8, n)."""
    found = arm.branches(T[0], count=60).q
    picked = [q0]
    while len(picked) < STARTS and len(found):
        away = np.min([np.abs(found - q).max(axis=1) for q in picked], axis=0)
        if away.max() < 1e-3:
            break
        picked.append(found[int(away.argmax())])
    return np.array(picked + [q0] * (STARTS - len(picked)))


def tried_again(arm: kinseek.Arm, kind: str, T: Array, q0: Array, peers: list[str]) -> list[str]:
    """Which peers follow a path from one of eight starts."""
    starts = eight_starts(arm, T, q0)[None]
    return [peer for peer in peers if measure_peer(arm, kind, peer, T[None], starts, SECONDS).followed]


def how_far(arm: kinseek.Arm, kind: str, T: Array) -> str:
    """How far any answers lead along poses, (N, 4, 4), over a grid of the last joint; empty where that is not looked at."""
    if kind == "raster" or arm.dof != 7:
        return ""
    joint, lower, upper = arm.joint_names[-1], arm.lower[-1], arm.upper[-1]
    values = lower + (upper - lower) * (np.arange(GRID) + 0.5) / GRID
    locked = [arm.with_locked({joint: float(value)}) for value in values]

    def answers(pose: Array) -> Array:
        found = [
            np.insert(one.branches(pose).q, 6, value, axis=1)
            for one, value in zip(locked, values, strict=True)
        ]
        return np.concatenate(found)

    def reached(layers: list[Array]) -> int:
        alive = layers[0]
        for k, layer in enumerate(layers[1:], 1):
            near = (np.abs(layer[:, None] - alive[None]).max(axis=2) < LARGEST).any(axis=1)
            if not near.any():
                return k
            alive = layer[near]
        return len(layers)

    layers = [answers(pose) for pose in T]
    forward, backward = reached(layers), len(T) - reached(layers[::-1])
    if forward == len(T):
        return f" Over {GRID} values of {joint} there are answers that lead from the first pose to the last."
    return (
        f" Over {GRID} values of {joint} no answers lead from the first pose to pose {forward}, nor from the last back to"
        f" pose {backward - 1}."
    )


def read(path: Path) -> dict[tuple[str, str, str, int], Cell]:
    """Cells that were measured before."""
    if not path.is_file():
        return {}
    kinds = {each.name: each.type for each in fields(Cell)}
    cells = []
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            cells.append(
                Cell(
                    **{k: {"int": int, "float": float, "str": str}[str(kinds[k])](v) for k, v in row.items()}
                )
            )
    return {cell.key: cell for cell in cells}


def keep(path: Path, cells: dict[tuple[str, str, str, int], Cell]) -> None:
    """Write all cells, through a file beside it: a stop in the middle loses nothing."""
    part = path.with_suffix(".part")
    with part.open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, [each.name for each in fields(Cell)])
        writer.writeheader()
        writer.writerows(asdict(cell) for cell in cells.values())
    part.replace(path)


def iklink(source: str) -> str:
    """How often the Panda of IKLink's demonstration must be placed anew, or why that is not known.

    Args:
        source: Where the files of its repository are: an address that ends in /, or a folder.
    """
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name in IKLINK_FILES:
                where = source + name if "://" in source else (Path(source).resolve() / name).as_uri()
                with urllib.request.urlopen(where, timeout=30) as answer:
                    (Path(folder) / Path(name).name).write_bytes(answer.read())
            robot, trajectory = (Path(folder) / Path(name).name for name in IKLINK_FILES)
            arm = kinseek.load(robot, base="world", tip="panda_hand")
            rows = np.genfromtxt(trajectory, delimiter=",", skip_header=1)
    except OSError as error:
        return f"IKLink's demonstration could not be read here: {error}."
    T = np.array([kinseek.pose(row[1:4], quat_xyzw=row[4:8] / np.linalg.norm(row[4:8])) for row in rows])
    speeds = np.array([2.175] * 4 + [2.61] * 3)
    began = time.process_time()
    path = arm.follow(T, times=rows[:, 0], velocity=speeds, threads=1)
    took = (time.process_time() - began) / len(T) * 1e6
    loose = arm.follow(T, max_step=LARGEST, threads=1)
    return (
        f"IKLink's demonstration, {len(T)} poses of a Panda at the joint speeds of its file: {len(path.breaks)} "
        f"re-placements, {int(path.reached.sum())} poses reached, {took:.0f} µs a pose; IKLink reports 2, with poses met to "
        f"1 mm and 0.01 rad. With steps up to {LARGEST} rad and no speeds: {len(loose.breaks)}."
    )


def travelled(cell: Cell, ours: Cell) -> tuple[str, str]:
    """Median travel of what was followed, and kinseek's over it where both followed."""
    lengths = cell.lengths
    if not lengths.any():
        return "–", "–"
    median = f"{np.median(lengths[lengths > 0]):.2f}"
    both = (lengths > 0) & (ours.lengths > 0)
    if cell is ours or not both.any():
        return median, ""
    return median, f"{np.median(ours.lengths[both] / lengths[both]):.3f}"


def page(cells: list[Cell], misses: list[str], demonstration: str, placements: int) -> Page:
    """The page."""
    versions = {cell.who: cell.release for cell in cells if cell.who != "kinseek"}
    page = Page("Paths beside peers", "benchmarks.path_peers", note=releases(versions))
    page.say(
        f"Each task has {placements} placements, the same for all methods. A placement is followed if every pose is within",
        f"{PLACE:g} m and {TURN:g} rad by plain NumPy forward kinematics, inside the limits, and if no joint moves",
        f"{LARGEST} rad or farther between two poses. kinseek, Descartes, the ladder and ssik get no start; the others get",
        "the joint values from which the task was made. *Joint travel* is the median over the placements that a method",
        "followed. *kinseek's relative to it* is the median of kinseek's travel divided by the method's, over the",
        "placements that both followed. Times are processor times of one thread. `benchmarks/workers/motion.py` has the",
        "settings. On rasters RTB, OptIK, TRAC-IK, the ladder and ssik do not use the turn that is free.",
    )
    page.table(
        "arm | task | who | >followed | >of | >joint travel, median rad | >kinseek's relative to it | >µs a waypoint | ",
        [
            (
                cell.arm,
                cell.kind,
                f"**{cell.who}**" if cell.who == "kinseek" else cell.who,
                cell.followed if cell.tried else "–",
                cell.tried if cell.tried else "–",
                *travelled(
                    cell, next(each for each in cells if each.key == (*cell.key[:2], "kinseek", placements))
                ),
                f"{cell.cost:.1f}" if np.isfinite(cell.cost) else "–",
                cell.note,
            )
            for cell in cells
        ],
    )
    page.head("What kinseek does not follow")
    page.items(misses, none="Nothing: every placement is followed.")
    page.head("IKLink's demonstration")
    page.say(demonstration)
    return page


def main() -> None:
    """Measure what is not known yet, and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("--arms", nargs="+", choices=TASK_ARMS, default=TASK_ARMS, help="names")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, help="of tasks")
    parser.add_argument("--peers", nargs="*", choices=list(FOLLOWERS), default=list(FOLLOWERS), help="names")
    parser.add_argument("--placements", type=at_least_one, default=50, help="of each task")
    parser.add_argument(
        "--again", nargs="*", default=(), help="peers, or kinseek, whose cells are measured anew"
    )
    parser.add_argument(
        "--quick", action="store_true", help="two placements each; nothing is kept or written"
    )
    parser.add_argument("--iklink", default=IKLINK, help="repository of IKLink, its raw address or a folder")
    writes(parser, "--output", HERE / "path_peers.md", "page to write; its cells are kept beside it")
    options = parser.parse_args()
    placements = 2 if options.quick else options.placements
    kept = options.output.with_suffix(".csv")
    cells = {} if options.quick else read(kept)
    cells = {key: cell for key, cell in cells.items() if cell.who not in options.again}
    shown, misses = [], []
    for name in options.arms:
        arm = kinseek.load(name)
        for kind in options.kinds:
            paths, made = tasks(arm, kind, placements)
            ours, reasons = measure_kinseek(arm, kind, paths)
            cells[ours.key] = ours
            shown.append(ours)
            print(ours, flush=True)
            for peer in options.peers:
                key = name, kind, peer, placements
                if key not in cells:
                    cells[key] = measure_peer(arm, kind, peer, paths, made[:, None], SECONDS)
                    if not options.quick:
                        keep(kept, cells)
                shown.append(cells[key])
                print(cells[key], flush=True)
            for i, reason in reasons.items():
                others = tried_again(arm, kind, paths[i], made[i], options.peers)
                by = f"followed by {', '.join(others)}" if others else "followed by no peer"
                far = how_far(arm, kind, paths[i])
                misses.append(f"{name} {kind} {i}: {reason}. From {STARTS} starts {by}.{far}")
                print(misses[-1], flush=True)
    demonstration = iklink(options.iklink)
    print(demonstration)
    if not options.quick:
        keep(kept, cells)
        page(shown, misses, demonstration, placements).write(options.output)


if __name__ == "__main__":
    main()
