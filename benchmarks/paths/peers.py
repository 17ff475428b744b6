"""kinseek and its peers on the same tasks, in the same run, each peer from its wheel, with one judge."""

from __future__ import annotations

import argparse
import tempfile
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

import kinseek
from benchmarks.page import Page, Row
from benchmarks.targets import Array, plain_fk, pose_errors
from benchmarks.timing import cpu
from benchmarks.workers.motion import FOLLOWERS
from benchmarks.workers.process import called, releases

from .curves import KINDS, LARGEST, TASK_ARMS, goal_of, placements

PLACE, TURN = 1e-4, 1e-3
"""Within which a pose counts [m], [rad]."""

STARTS, SECONDS = 8, 540
"""Starts for what kinseek missed, and time of a peer for one kind of task [s]: what is not done by then is not counted."""

FOLLOW = "benchmarks.workers.motion", "follow", SECONDS + 300

GRID = 120
"""Values of the last joint over which all solutions are found."""

FINE, WIDER = 2000, 1.0
"""Such values for IKLink's demonstration, and what is added to the steps there [rad], for solutions between two values: they
are nearer to those at the values."""

IKLINK = "https://raw.githubusercontent.com/uwgraphics/IKLink/HEAD/"
"""Wang, Sifferman and Gleicher 2024, *IKLink*, MIT licence; read when this runs, not kept here."""

IKLINK_FILES = ("configs/urdfs/panda.urdf", "input_trajectories/panda_2023-08-25_11-37-55.csv")
"""Its Panda, and the demonstration."""


@dataclass(frozen=True)
class Followed:
    """What became of the tasks of one kind."""

    lengths: Array
    """Length of the way of the joints [rad], 0 where a task was not followed, (P,)."""
    costs: Array
    """Processor time of a waypoint [µs], NaN of what was not tried, (P,)."""


def peers(page: Page, options: argparse.Namespace) -> None:
    """Write the section."""
    page.head("Beside peers")
    page.say(
        "The tasks of the section before. kinseek, Descartes, the ladder and ssik get no start; the others get the joint",
        f"values from which the task was made. A task is followed if every pose is within {PLACE:g} m and {TURN:g} rad by",
        f"plain NumPy forward kinematics, inside the limits, and if no joint moves {LARGEST} rad or farther between two",
        "poses.",
        "*Joint travel* is the median over what a method followed; *kinseek's relative to it* is the median of kinseek's",
        "travel divided by the method's, over what both followed. Times are processor times of one thread.",
        "`benchmarks/workers/motion.py` has the settings. On rasters RTB, OptIK, TRAC-IK, the ladder and ssik do not use",
        "the turn that is free.",
    )
    versions: dict[str, str] = {}
    misses: list[str] = []
    names = [name for name in TASK_ARMS if name in options.arms]
    page.rows(
        row
        for name in names
        for kind in KINDS
        for row in _compared(kinseek.load(name), kind, options, misses, versions)
    )
    page.say(releases(versions))
    page.say(
        f"What kinseek does not follow; peers try it again from {STARTS} starts. For arms with one redundant joint the page",
        "says how far any solution leads, over a grid of the last joint:",
    )
    page.items(misses, none="Nothing: every task is followed.")
    page.say(iklink(options.iklink))


def _compared(
    arm: kinseek.Arm,
    kind: str,
    options: argparse.Namespace,
    misses: list[str],
    versions: dict[str, str],
) -> Iterator[Row]:
    """Rows of kinseek and of every peer on one kind of task."""
    paths, made = placements(arm, [kind] * options.placements, 7)
    ours, reasons = by_kinseek(arm, kind, paths)
    yield _row(arm, kind, "**kinseek**", ours, ours)
    for peer in options.peers:
        theirs, told = by_peer(arm, kind, peer, paths, made[:, None])
        if theirs is not None:
            versions[peer] = told
        yield _row(arm, kind, peer, theirs, ours, "" if theirs else told)
    for i, reason in reasons.items():
        starts = eight_starts(arm, paths[i], made[i])[None]
        found = ((peer, by_peer(arm, kind, peer, paths[i][None], starts)[0]) for peer in options.peers)
        by = ", ".join(peer for peer, each in found if each is not None and each.lengths.any())
        far = how_far(arm, kind, paths[i])
        misses.append(f"{arm.name} {kind} {i}: {reason}. Followed by {by or 'no peer'}.{far}")


def _row(
    arm: kinseek.Arm, kind: str, who: str, theirs: Followed | None, ours: Followed, note: str = ""
) -> Row:
    cells: Row = {"arm": arm.name, "task": kind, "who": who}
    columns = ">followed", ">of", ">joint travel, median rad", ">kinseek's relative to it", ">µs a waypoint"
    if theirs is None or not np.isfinite(theirs.costs).any():
        return cells | dict.fromkeys(columns, "–") | {"": note}
    good, both = theirs.lengths > 0, (theirs.lengths > 0) & (ours.lengths > 0)
    figures = (
        int(good.sum()),
        int(np.isfinite(theirs.costs).sum()),
        f"{np.median(theirs.lengths[good]):.2f}" if good.any() else "–",
        f"{np.median(ours.lengths[both] / theirs.lengths[both]):.3f}" if both.any() else "–",
        f"{np.nanmedian(theirs.costs):.1f}",
    )
    return cells | dict(zip(columns, figures, strict=True)) | {"": note}


def is_followed(arm: kinseek.Arm, kind: str, q: Array, T: Array) -> bool:
    """Is a path, (N, n), followed? By plain forward kinematics, which shares nothing with whom it judges."""
    if not np.isfinite(q).all():
        return False
    found = plain_fk(arm.chain, q)
    place, turn = pose_errors(found, T)
    if kind == "raster":
        sine = np.linalg.norm(np.cross(found[:, :3, 2], T[:, :3, 2]), axis=1)
        turn = np.arctan2(sine, (found[:, :3, 2] * T[:, :3, 2]).sum(axis=1))
    within = ((q >= arm.lower - 1e-9) & (q <= arm.upper + 1e-9)).all()
    small = np.abs(np.diff(q, axis=0)).max() < LARGEST
    return bool(within and small and (place <= PLACE).all() and (turn <= TURN).all())


def judged(arm: kinseek.Arm, kind: str, rows: Any, paths: Array, costs: Any) -> Followed:
    """Judge joint values, (P, N, n), along poses, (P, N, 4, 4)."""
    lengths = [
        float(np.linalg.norm(np.diff(q, axis=0), axis=1).sum()) if is_followed(arm, kind, q, T) else 0.0
        for q, T in zip(rows, paths, strict=True)
    ]
    return Followed(np.array(lengths), np.array(costs, dtype=float))


def by_kinseek(arm: kinseek.Arm, kind: str, paths: Array) -> tuple[Followed, dict[int, str]]:
    """Follow every path from no start; also why each that was missed was missed."""
    arm.follow(goal_of(kind, paths[0][:40]), threads=1)
    rows, costs, reasons = [], [], dict[int, str]()
    for i, T in enumerate(paths):
        step = LARGEST * (1 - 1e-9)
        took, path = cpu(lambda T=T, step=step: arm.follow(goal_of(kind, T), max_step=step, threads=1))
        rows.append(path.q)
        costs.append(took / len(T) * 1e6)
        if not path.success:
            reasons[i] = "; ".join(path.why[:3]) or str(path.status)
    found = judged(arm, kind, rows, paths, costs)
    for i in np.flatnonzero(found.lengths == 0.0).tolist():
        reasons.setdefault(i, "said to be followed, and is not by plain forward kinematics")
    return found, reasons


def by_peer(
    arm: kinseek.Arm, kind: str, peer: str, paths: Array, starts: Array
) -> tuple[Followed | None, str]:
    """Let a peer follow every path, from one start after another, and its version; or nothing, and why."""
    task = {"paths": paths, "starts": starts, "free": kind == "raster", "seconds": SECONDS}
    found = called(FOLLOWERS[peer][0], *FOLLOW, arm=arm.name, peer=peer, **task)
    if isinstance(found, str):
        return None, found
    return judged(arm, kind, np.array(found["q"], dtype=float), paths, found["times"]), found["version"]


def eight_starts(arm: kinseek.Arm, T: Array, q0: Array) -> Array:
    """The joint values that made a task and seven other solutions of its first pose, far from one another, (8, n)."""
    found = arm.branches(T[0], count=60).q
    picked = [q0]
    while len(picked) < STARTS and len(found):
        away = np.min([np.abs(found - q).max(axis=1) for q in picked], axis=0)
        if away.max() < 1e-3:
            break
        picked.append(found[int(away.argmax())])
    return np.array(picked + [q0] * (STARTS - len(picked)))


def how_far(arm: kinseek.Arm, kind: str, T: Array) -> str:
    """How far any solutions lead along poses, (N, 4, 4), over a grid of the last joint; empty if not looked at."""
    if kind == "raster" or arm.dof != 7:
        return ""
    layers, joint = solutions_over(arm, T, GRID), arm.joint_names[-1]
    forward, backward = (fewest_breaks(some, np.full(7, LARGEST)) for some in (layers, layers[::-1]))
    if not forward:
        return f" Over {GRID} values of {joint} solutions lead from the first pose to the last."
    return (
        f" Over {GRID} values of {joint} no solutions lead from the first pose to pose {forward[0]}, nor from the last back "
        f"to pose {len(T) - backward[0] - 1}."
    )


def solutions_over(arm: kinseek.Arm, T: Array, count: int) -> list[Array]:
    """All solutions of poses, (N, 4, 4), of an arm of seven joints at values of the last joint, (k, 7) for each pose."""
    values = arm.lower[-1] + (arm.upper[-1] - arm.lower[-1]) * (np.arange(count) + 0.5) / count
    # The last joint moves the tip by the same transform wherever the others are, so one locked arm has all solutions.
    locked, q = arm.with_locked({arm.joint_names[-1]: 0.0}), np.zeros((count, 7))
    q[:, -1] = values
    back = np.linalg.inv(arm.fk(q)) @ arm.fk(np.zeros(7))
    return [
        np.concatenate(
            [
                np.insert(locked.branches(pose @ one).q, 6, value, axis=1)
                for one, value in zip(back, values, strict=True)
            ]
        )
        for pose in T
    ]


def fewest_breaks(layers: list[Array], step: Array) -> list[int]:
    """Poses at which a motion must begin anew, if it takes solutions of layers, (k, n), by steps up to `step`, (n,).

    No motion has fewer breaks: each part leads as far as any solution of its first pose does.
    """
    breaks, alive = list[int](), layers[0]
    for k, layer in enumerate(layers[1:], 1):
        distance, _ = cKDTree(alive / step).query(layer / step, p=np.inf, distance_upper_bound=1.0)
        if np.isfinite(distance).any():
            alive = layer[np.isfinite(distance)]
        else:
            breaks.append(k)
            alive = layer
    return breaks


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
    took, path = cpu(lambda: arm.follow(T, times=rows[:, 0], velocity=speeds, threads=1))
    loose = arm.follow(T, max_step=LARGEST, threads=1)
    layers = solutions_over(arm, T, FINE)
    breaks = fewest_breaks(layers, speeds * np.diff(rows[:, 0]).max() + WIDER)
    return (
        f"IKLink's demonstration, {len(T)} poses of a Panda at the joint speeds of its file: {len(path.breaks)} "
        f"re-placements, {int(path.reached.sum())} poses reached, {took / len(T) * 1e6:.0f} µs a pose; IKLink reports 2, "
        f"with poses met to 1 mm and 0.01 rad. With steps up to {LARGEST} rad and no speeds: {len(loose.breaks)}. "
        f"Over {FINE} values of the last joint, no solutions lead from the first pose to the last with fewer than "
        f"{len(breaks)}: the parts end before pose {' and '.join(map(str, breaks))} at the latest, even if each joint may "
        f"move {WIDER:g} rad farther in a step than its speed allows."
    )
