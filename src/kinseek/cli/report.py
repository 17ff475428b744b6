"""The output of the commands: tables for people, JSON for programs."""

from __future__ import annotations

import json
import math
import shlex
from collections import Counter
from collections.abc import Sequence
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.result import Branches
from kinseek.goal import Goal
from kinseek.paths.path import Path
from kinseek.printable import printable
from kinseek.proof.certificate import Certificate
from kinseek.robots import catalog_entry, catalog_names
from kinseek.robots.checks import Severity
from kinseek.robots.soundness import Checkup
from kinseek.solution import Solution
from kinseek.solvers.base import Solver
from kinseek.support.transforms import quaternion
from kinseek.tables import branches_table, solution_table

from .layout import sentence, table, terminal_width

if TYPE_CHECKING:
    from kinseek.export import Parts
    from kinseek.timing.trajectory import Trajectory


Array = NDArray[np.float64]

_POSTURES = 20_000
"""Number of postures from which `show` measures the reach."""
_ENDLESS = 100_000
"""Line length that fits any table."""
_LISTED = 10
"""Maximum number of rows, reasons or contacts that are listed for people."""


def print_robots() -> None:
    """Print the bundled arms."""
    entries = map(catalog_entry, catalog_names())
    _print_table(("name", ">joints", "description"), [(e.name, str(e.dof), e.description) for e in entries])


def print_arm(arm: Arm, limits: str = "") -> None:
    """Print joints, limits, speeds and reach, and the source of the limits if it is known.

    Accelerations and jerks are printed if any is known.
    """
    _print(f"{arm.name}: {arm.dof} joints, base {arm.base}, tip {arm.tip}")
    small, large = _units(arm.kinds)
    rates = [(">speed\nper second", arm.velocity)]
    more = (">acceleration\nper second^2", arm.acceleration), (">jerk\nper second^3", arm.jerk)
    rates += [(title, values) for title, values in more if np.isfinite(values).any()]
    rows = []
    for i, (name, kind, lower, upper) in enumerate(
        zip(arm.joint_names, arm.kinds, arm.lower, arm.upper, strict=True)
    ):
        scale = 1000.0 if kind == "prismatic" else float(np.rad2deg(1.0))
        ends = [f"{lower:.6f}", f"{upper:.6f}", f"{lower * scale:.3f}", f"{upper * scale:.3f}"]
        limits_of_it = ["none"] * 4 if kind == "continuous" else ends
        fastest = [f"{values[i]:.4g}" if np.isfinite(values[i]) else "-" for _, values in rates]
        rows.append((name, kind, *limits_of_it, *fastest))
    columns = (
        "joint",
        "kind",
        f">lower\n{small}",
        f">upper\n{small}",
        f">lower\n{large}",
        f">upper\n{large}",
        *(title for title, _ in rates),
    )
    _print_table(columns, rows, (2, 2, 2, len(rates)))
    if limits:
        _print(f"limits: {limits}")
    least, most = reach(arm)
    least, most = math.floor(least * 1e3) / 1e3, math.ceil(most * 1e3) / 1e3
    _print(f"reach: at least {least:.3f} m from base to tip (the farthest of {_POSTURES:,} random postures)")
    _print(f"reach: at most {most:.3f} m from base to tip (the sum of all links and slides)")


def print_checkup(name: str, found: Checkup, as_json: bool) -> None:
    """Print the findings about a file, the most severe first."""
    order = list(Severity)
    findings = sorted(found.findings, key=lambda finding: order.index(finding.severity))
    if as_json:
        listed = [{"severity": f.severity.value, "part": f.part, "what": f.what} for f in findings]
        print_json({"file": name, "sound": found.sound, "findings": listed})
        return
    for finding in findings:
        _print(f"{finding.severity.value}: {finding.part}{': ' if finding.part else ''}{finding.what}")
    counts = Counter(
        finding.severity.value for finding in findings
    )  # The most severe first, as they are sorted.
    verdict = ["sound" if found.sound else "not sound", *(_count(n, kind) for kind, n in counts.items())]
    size = (
        f" ({found.links} links, {found.joints} joints, {found.moving} of them move)" if found.links else ""
    )
    _print(f"{name}{size}: {', '.join(verdict)}")


def print_parts(folder: FilePath, parts: Parts) -> None:
    """Print what was written for a controller, and how to build a program from it."""
    _print(f"{folder}: {', '.join(sorted(parts.files))}")
    place = folder.as_posix()  # Also works unquoted in cmd.exe.
    place = f"./{place}" if place.startswith("-") else place
    print(f"cd {shlex.quote(printable(place))} && {parts.command}")  # One line, for copying.


def _units(kinds: Sequence[str]) -> tuple[str, str]:
    """Return units of joint values: the small and the large ones."""
    slides, turns = "prismatic" in kinds, any(kind != "prismatic" for kind in kinds)
    if slides and turns:
        return "rad or m", "deg or mm"
    return ("m", "mm") if slides else ("rad", "deg")


def reach(arm: Arm) -> tuple[float, float]:
    """Return the largest distance of the tip from the base [m]: measured, and bounded by the links' lengths."""
    return float(np.linalg.norm(arm.fk(arm.sample(_POSTURES))[:, :3, 3], axis=1).max()), arm.chain.reach


def print_pose(arm: Arm, q: Array, T: Array, as_json: bool) -> None:
    """Print a pose of the tip in the base."""
    wxyz = quaternion(T[:3, :3])
    xyzw = np.roll(wxyz, -1)
    if as_json:
        facts = {"position": T[:3, 3], "quat_wxyz": wxyz, "quat_xyzw": xyzw, "matrix": T}
        print_json({**_arm_facts(arm), "q": q.tolist(), **{k: v.tolist() for k, v in facts.items()}})
        return
    _print(f"{arm.tip} in {arm.base}")
    rows = [("position", "x y z in m", _row(T[:3, 3])), ("quaternion", "w x y z", _row(wxyz))]
    rows += [("matrix" if r == 0 else "", f"row {r + 1}", _row(T[r])) for r in range(4)]
    _print_table(("", "", ""), rows)


def print_solution(
    arm: Arm,
    solution: Solution,
    search: Solver | None,
    seconds: float,
    as_json: bool,
    proof: Certificate | None = None,
    in_scene: bool = False,
) -> None:
    """Print a solution and its errors."""
    if as_json:
        facts = solution_facts(arm, solution, search, seconds, proof, in_scene)
        print_json(facts | ({"trace": solution.trace.to_dict()} if solution.problem.trace else {}))
        return
    if solution.problem.trace:
        print(solution.trace)
    rows = []
    for joint in _joint_facts(arm, solution.q):
        kind, room = joint["kind"], joint["to_limit"]
        left = "no limit" if room is None else " = ".join(_both(kind, room))
        rows.append((joint["name"], *_both(kind, joint["value"]), left))
    _print_table(("joint", ">rad or m", ">deg or mm", ">to the nearer limit"), rows)
    _print(f"{solution.status}")
    if in_scene:
        _print_contacts(solution)
    goal = solution.problem.goal
    place = ("position", f"{solution.position_error:.3g} m", f"{goal.position_tolerance:g} m")
    turn = ("orientation", "any", "any")
    if goal.form.columns:
        error, tolerance = solution.orientation_error, goal.orientation_tolerance
        turn = ("orientation", f"{error:.3g} rad", f"{tolerance:g} rad")
    _print_table(("", ">error", ">tolerance"), [place, turn])
    if proof is not None:
        _print(
            f"weighted error: {proof.upper_bound:.6g} of the pose found, at least {proof.lower_bound:.6g} of any pose; "
            f"{proof.boxes:,} boxes examined"
        )
    work = [f"{solution.evaluations:,} FK evaluations"]
    work += [f"{solution.nodes_created:,} nodes created"] * (solution.nodes_created > 0)
    work += [f"{solution.nodes_expanded:,} nodes expanded"] * (solution.nodes_expanded > 0)
    _print(f"{', '.join(work)}, {seconds:.3g} s (loading compiled kernels included)")


def _print_contacts(solution: Solution) -> None:
    """Print how many solutions collide, and the contacts of a blocked one."""
    blocked = _count(int(solution.blocked), "solution")
    if solution.success and solution.blocked:
        _print(f"{blocked} with collisions were rejected before this one")
    elif solution.contacts:
        _print(f"{blocked} with collisions; contacts of the one that collides least:")
        _print_list(solution.contacts)


def solution_facts(
    arm: Arm,
    solution: Solution,
    search: Solver | None,
    seconds: float,
    proof: Certificate | None = None,
    in_scene: bool = False,
) -> dict[str, Any]:
    """Return the full report of `solve` as JSON takes it: lengths in m, angles in rad, time in s."""
    return {
        **_arm_facts(arm),
        "goal": _goal_facts(solution.problem.goal),
        "solver": "default" if search is None else repr(search),
        "sentence": str(solution.status),
        "joints": _joint_facts(arm, solution.q),
        **line_facts(solution, in_scene),
        "nodes_created": int(solution.nodes_created),
        "nodes_expanded": int(solution.nodes_expanded),
        "seconds": seconds,
        "proof": None if proof is None else _proof_facts(proof),
    }


def _joint_facts(arm: Arm, q: Array) -> list[dict[str, Any]]:
    """Return each joint's value, limits and distance to the nearer limit; None for a limit that it does not have."""
    facts = []
    for name, kind, value, lower, upper in zip(
        arm.joint_names, arm.kinds, q.tolist(), arm.lower.tolist(), arm.upper.tolist(), strict=True
    ):
        ends: dict[str, float | None] = {"lower": None, "upper": None, "to_limit": None}
        if kind != "continuous":
            ends = {"lower": lower, "upper": upper, "to_limit": min(value - lower, upper - value)}
        facts.append({"name": name, "kind": kind, "value": value, **ends})
    return facts


def line_facts(solution: Solution, in_scene: bool = False) -> dict[str, Any]:
    """Return the report of a solution in a line of JSON."""
    (facts,) = solution_table(solution).records()
    if not in_scene:
        return facts
    contacts = [{"a": each.a, "b": each.b, "depth": each.depth} for each in solution.contacts]
    return {**facts, "blocked": int(solution.blocked), "contacts": contacts}


def branches_facts(found: Branches, in_scene: bool = False) -> dict[str, Any]:
    """Return all solutions of a goal, as JSON takes them."""
    facts = {
        "branches": branches_table(found).records(),
        "complete": found.complete,
        "sampled": found.sampled,
        "evaluations": int(found.evaluations),
    }
    if not in_scene:
        return facts
    return {**facts, "blocked": int(found.rejected), "proved_blocked": bool(found.proved_blocked)}


def print_branches(arm: Arm, found: Branches, seconds: float, as_json: bool, in_scene: bool = False) -> None:
    """Print every solution of a goal."""
    goal = found.problem.goal
    if as_json:
        facts = branches_facts(found, in_scene)
        print_json({**_arm_facts(arm), "goal": _goal_facts(goal), **facts, "seconds": seconds})
        return
    room = np.minimum(found.q - arm.lower, arm.upper - found.q)
    room[:, [kind == "continuous" for kind in arm.kinds]] = np.inf
    rows = [
        (str(k + 1), *(f"{value:.6f}" for value in q), f"{least:.6f}" if np.isfinite(least) else "none")
        for k, (q, least) in enumerate(zip(found.q, room.min(axis=1), strict=True))
    ]
    if rows:
        _print_solutions(arm, rows)
    _print(_how_many(found))
    if in_scene and found.proved_blocked:
        _print("proved: the arm collides in every solution")
    elif in_scene and found.rejected:
        _print(f"{_count(int(found.rejected), 'solution')} with collisions left out")
    if rows:
        worst = [f"position {found.position_error.max():.3g} m"]
        worst += [f"orientation {found.orientation_error.max():.3g} rad"] * bool(goal.form.columns)
        _print(f"largest errors: {', '.join(worst)}")
    _print(f"{found.evaluations:,} FK evaluations, {seconds:.3g} s (loading compiled kernels included)")


def _print_solutions(arm: Arm, rows: Sequence[Sequence[str]]) -> None:
    """Print solutions, one per line; if names of joints are too wide for that, use short ones."""
    units = ["m" if kind == "prismatic" else "rad" for kind in arm.kinds]
    short = [f"j{i + 1}" for i in range(arm.dof)]

    def columns(names: Sequence[str]) -> list[str]:
        return [
            ">",
            *(f">{printable(name)}\n{unit}" for name, unit in zip(names, units, strict=True)),
            ">to the\nlimit",
        ]

    width, names = terminal_width(), arm.joint_names
    if width is not None and max(map(len, table(columns(names), rows, _ENDLESS).splitlines())) > width:
        _print(", ".join(f"{one} {name}" for one, name in zip(short, names, strict=True)))
        names = tuple(short)
    _print_table(columns(names), rows)


def print_batch(arm: Arm, reached: NDArray[np.bool_], out: str, seconds: float, as_json: bool) -> None:
    """Print the results for the poses of a file, (N,)."""
    missed = (np.flatnonzero(~reached) + 1).tolist()
    if as_json:
        facts = {"poses": len(reached), "reached": int(reached.sum()), "not_reached": missed}
        print_json({**_arm_facts(arm), **facts, "out": out, "seconds": seconds})
        return
    _print(f"{len(reached):,} poses: {int(reached.sum()):,} reached, {len(missed):,} not; {seconds:.3g} s")
    if missed:
        listed = ", ".join(f"{row:,}" for row in missed[:_LISTED])
        _print(f"not reached: row {listed}{' and others' if len(missed) > _LISTED else ''}")
    _print(f"solutions: {out}")


class PathFiles(NamedTuple):
    """Output files of `follow`."""

    out: FilePath | None
    """That of the joint values."""
    trajectory: FilePath | None
    """That of the trajectory."""


def print_path(
    arm: Arm, path: Path, trajectory: Trajectory | None, files: PathFiles, seconds: float, as_json: bool
) -> None:
    """Print the result for a path. Poses count from 0 as in Python; rows of a file, called "row", count from 1."""
    facts = {
        "poses": len(path),
        "status": path.status.name,
        "missed": np.flatnonzero(~path.reached).tolist(),
        "break_after": path.breaks.tolist(),
        "not_planned": np.flatnonzero(~path.planned).tolist(),
    }
    strays = path.deviation
    if as_json:
        facts |= {"why": list(path.why), "largest_step": path.largest_step.tolist(), "length": path.length}
        facts |= {"deviation": {"distance": strays.distance, "turn": strays.turn}}
        if path.proof is not None:
            facts |= {"certified": path.certified, "proved_steps": int(path.proved.sum())}
            facts |= {"impossible": [list(pair) for pair in path.impossible]}
        if files.out is not None:
            facts["out"] = str(files.out)
        if files.trajectory is not None:
            facts["trajectory"] = (
                None if trajectory is None else _trajectory_facts(trajectory, files.trajectory)
            )
        print_json({**_arm_facts(arm), **facts, "seconds": seconds})
        return
    _print(f"{len(path):,} poses, {seconds:.3g} s. {path.status}")
    if path.why:
        _print("poses are counted from 0:")
    _print_list(path.why)
    rows = [
        (name, *_both(kind, float(step)))
        for name, kind, step in zip(arm.joint_names, arm.kinds, path.largest_step, strict=True)
    ]
    _print_table(("joint", ">largest step", ">"), rows)
    _print(
        f"between two poses the hand deviates by up to {strays.distance * 1e3:.3g} mm and "
        f"{np.rad2deg(strays.turn):.3g} deg"
    )
    if path.proof is not None:
        whole = "the whole path" if path.certified else f"{path.proved.sum():,} of {len(path.proved):,} steps"
        _print(f"proved to be unbroken, inside the limits: {whole}")
    if files.out is not None:
        _print(f"joint values: {files.out}")
    if files.trajectory is not None:
        _print_trajectory(trajectory, files.trajectory)


def _print_trajectory(trajectory: Trajectory | None, file: FilePath) -> None:
    if trajectory is None:
        _print(f"no trajectory, since some poses are missed; {file} is not written")
        return
    _print(
        f"fastest motion within the limits: {trajectory.duration:.4g} s, {_count(len(trajectory.stops), 'stop')}"
    )
    shares = _shares_of_caps(trajectory)
    rows = [(limit, joint or "", f"{100 * share:.0f} %") for (limit, joint), share in shares.items()]
    _print_table(("speed is capped by", "joint", ">of the time"), rows)
    _print(
        f"between two poses the tip is at most {trajectory.deviation * 1e3:.3g} mm from the straight line, which is proved"
    )
    _print(f"trajectory: {file}")


def _shares_of_caps(trajectory: Trajectory) -> dict[tuple[str, str | None], float]:
    """Return the share of the time in which each limit of each joint caps the speed, the largest first."""
    seconds = dict[tuple[str, str | None], float]()
    for cap in trajectory.bottleneck:
        key = cap.limit.replace("_", " "), cap.joint
        seconds[key] = seconds.get(key, 0.0) + cap.end - cap.begin
    listed = sorted(seconds.items(), key=lambda each: -each[1])
    return {key: spent / trajectory.duration for key, spent in listed}


def _trajectory_facts(trajectory: Trajectory, file: FilePath) -> dict[str, Any]:
    kept = trajectory.limits_kept
    return {
        "out": str(file),
        "duration": trajectory.duration,
        "stops": trajectory.stops.tolist(),
        "deviation": trajectory.deviation,
        "limits_kept": {
            limit: share.tolist() if isinstance(share, np.ndarray) else share
            for limit, share in kept._asdict().items()
        },
        "bottleneck": [cap._asdict() for cap in trajectory.bottleneck],
    }


def _how_many(found: Branches) -> str:
    count = _count(len(found), "solution")
    if found.sampled and not len(found):
        return "no solution found; not proved that there is none"
    if found.sampled:
        return f"{count}, a well-spread sample of infinitely many"
    if found.complete:
        return f"{count}; proved to be all"
    return f"{count}; not proved to be all (--prove tries to)"


def _goal_facts(goal: Goal) -> dict[str, Any]:
    ranges = {axis: [end if np.isfinite(end) else None for end in pair] for axis, pair in goal.within.items()}
    return {
        "kind": goal.kind,
        "target": goal.target.tolist(),
        "free": list(goal.free),
        "ranges": ranges,
        "cone": goal.cone,
        "frame": goal.frame,
        "position_tolerance": goal.position_tolerance,
        "orientation_tolerance": goal.orientation_tolerance,
        "position_weight": goal.position_weight,
        "orientation_weight": goal.orientation_weight,
    }


def _proof_facts(proof: Certificate) -> dict[str, Any]:
    return {
        "verdict": proof.verdict.name,
        "sentence": str(proof.verdict),
        "lower_bound": float(proof.lower_bound),
        "upper_bound": float(proof.upper_bound),
        "boxes": int(proof.boxes),
        "largest_box": float(proof.largest_box),
    }


def _arm_facts(arm: Arm) -> dict[str, Any]:
    return {
        "arm": arm.name,
        "base": arm.base,
        "tip": arm.tip,
        "joint_names": list(arm.joint_names),
    }


def _both(kind: str, value: float) -> tuple[str, str]:
    """Format a joint's value in rad and deg, or in m and mm."""
    if kind == "prismatic":
        return f"{value:.6f} m", f"{value * 1000:.3f} mm"
    return f"{value:.6f} rad", f"{np.rad2deg(value):.3f} deg"


def _count(count: int, noun: str) -> str:
    return f"{count} {noun}{'s' if count != 1 else ''}"


def _row(values: Array) -> str:
    return " ".join(f"{round(value, 9) + 0.0:12.9f}" for value in values)  # Adding zero turns -0 into 0.


def _print_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], blocks: Sequence[int] | None = None
) -> None:
    print(table(columns, rows, terminal_width(), blocks))


def _print(text: str) -> None:
    print(sentence(text, terminal_width()))


def _print_list(items: Sequence[object]) -> None:
    """Print the first items, one per line, and the number of the others."""
    for item in items[:_LISTED]:
        _print(f"- {item}")
    if len(items) > _LISTED:
        _print(f"- and {len(items) - _LISTED} more")


def print_json(facts: dict[str, Any]) -> None:
    """Print one JSON object."""
    print(json.dumps(facts, indent=2, allow_nan=False))
