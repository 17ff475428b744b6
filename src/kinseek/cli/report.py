"""What the commands print: tables for people, JSON for programs."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from kinseek.arm import Arm
from kinseek.robots import catalog_entry, catalog_names
from kinseek.solution import Solution
from kinseek.solvers import Solver

Array = NDArray[np.float64]

_POSTURES = 20_000
"""Postures from which `show` measures the reach."""


def print_robots() -> None:
    """Print the bundled arms."""
    table = _table("name", ">joints", "description")
    for entry in map(catalog_entry, catalog_names()):
        table.add_row(entry.name, str(entry.dof), escape(entry.description))
    _print(table)


def print_arm(arm: Arm) -> None:
    """Print joints, limits and reach."""
    _print(f"{arm.name}: {arm.dof} joints, base {arm.chain.base}, tip {arm.chain.tip}")
    table = _table("joint", "kind", ">lower", ">upper", ">lower", ">upper")
    for name, kind, lower, upper in zip(arm.joint_names, arm.chain.kinds, arm.lower, arm.upper, strict=True):
        free = kind == "continuous"
        limits = ["none"] * 4 if free else [*_both(kind, lower), *_both(kind, upper)]
        table.add_row(name, kind, limits[0], limits[2], limits[1], limits[3])
    _print(table)
    least, most = reach(arm)
    _print(f"reach, base to tip: at least {least:.3f} m (the farthest of {_POSTURES:,} random postures),")
    _print(f"                    at most  {most:.3f} m (the sum of all links and slides)")


def reach(arm: Arm) -> tuple[float, float]:
    """Largest distance of the tip from the base [m]: one measured, and one bounded by link sums."""
    postures = np.random.default_rng(0).uniform(arm.lower, arm.upper, (_POSTURES, arm.dof))
    measured = float(np.linalg.norm(arm.fk(postures)[:, :3, 3], axis=1).max())
    chain = arm.chain
    ends = chain.multiplier * np.stack([chain.lower, chain.upper])[:, chain.leader] + chain.offset
    slides = float(np.abs(ends).max(axis=0)[chain.prismatic].sum())
    return measured, float(np.linalg.norm(chain.fixed[:, :, 3], axis=1).sum()) + slides


def print_pose(arm: Arm, q: Array, T: Array, as_json: bool) -> None:
    """Print a pose of the tip in the base."""
    from scipy.spatial.transform import Rotation

    xyzw = Rotation.from_matrix(T[:3, :3]).as_quat(canonical=True)
    wxyz = np.roll(xyzw, 1)
    if as_json:
        facts = {"position": T[:3, 3], "quat_wxyz": wxyz, "quat_xyzw": xyzw, "matrix": T}
        _print_json({**_arm_facts(arm), "q": q.tolist(), **{k: v.tolist() for k, v in facts.items()}})
        return
    _print(f"{arm.chain.tip} in {arm.chain.base}")
    table = Table(box=None, show_header=False, pad_edge=False)
    table.add_row("position", "x y z in m", _row(T[:3, 3]))
    table.add_row("quaternion", "w x y z", _row(wxyz))
    for r in range(4):
        table.add_row("matrix" if r == 0 else "", f"row {r + 1}", _row(T[r]))
    _print(table)


def print_solution(
    arm: Arm, solution: Solution, search: Solver | None, seconds: float, as_json: bool
) -> None:
    """Print an answer and how good it is."""
    facts = solution_facts(arm, solution, search, seconds)
    if as_json:
        _print_json(facts)
        return
    goal = solution.problem.goal
    table = _table("joint", ">rad or m", ">deg or mm", ">to the nearer limit")
    for joint in facts["joints"]:
        room = (
            "no limit" if joint["to_limit"] is None else " = ".join(_both(joint["kind"], joint["to_limit"]))
        )
        table.add_row(joint["name"], *_both(joint["kind"], joint["value"]), room)
    _print(table)
    _print(f"{solution.status}")
    lines = _table("", ">error", ">tolerance")
    lines.add_row("position", f"{solution.position_error:.3g} m", f"{goal.position_tolerance:g} m")
    if goal.kind == "position":
        lines.add_row("orientation", "any", "any")
    else:
        lines.add_row(
            "orientation", f"{solution.orientation_error:.3g} rad", f"{goal.orientation_tolerance:g} rad"
        )
    _print(lines)
    work = [f"{solution.evaluations:,} FK evaluations"]
    work += [f"{solution.nodes_created:,} nodes created"] * (solution.nodes_created > 0)
    work += [f"{solution.nodes_expanded:,} nodes expanded"] * (solution.nodes_expanded > 0)
    _print(f"{', '.join(work)}, {seconds:.3g} s (loading compiled kernels included)")


def solution_facts(arm: Arm, solution: Solution, search: Solver | None, seconds: float) -> dict[str, Any]:
    """All that `solve` says, as JSON takes it: lengths in m, angles in rad, time in s."""
    goal = solution.problem.goal
    room = np.minimum(solution.q - arm.lower, arm.upper - solution.q)
    joints = [
        {
            "name": name,
            "kind": kind,
            "value": float(value),
            "lower": None if kind == "continuous" else float(lower),
            "upper": None if kind == "continuous" else float(upper),
            "to_limit": None if kind == "continuous" else float(left),
        }
        for name, kind, value, lower, upper, left in zip(
            arm.joint_names, arm.chain.kinds, solution.q, arm.lower, arm.upper, room, strict=True
        )
    ]
    return {
        **_arm_facts(arm),
        "goal": {
            "kind": goal.kind,
            "target": goal.target.tolist(),
            "position_tolerance": goal.position_tolerance,
            "orientation_tolerance": goal.orientation_tolerance,
            "position_weight": goal.position_weight,
            "orientation_weight": goal.orientation_weight,
        },
        "solver": "default" if search is None else repr(search),
        "success": bool(solution.success),
        "status": solution.status.name,
        "sentence": str(solution.status),
        "q": solution.q.tolist(),
        "joints": joints,
        "position_error": float(solution.position_error),
        "orientation_error": None if goal.kind == "position" else float(solution.orientation_error),
        "weighted_error": float(solution.weighted_error),
        "evaluations": int(solution.evaluations),
        "nodes_created": int(solution.nodes_created),
        "nodes_expanded": int(solution.nodes_expanded),
        "seconds": seconds,
    }


def _arm_facts(arm: Arm) -> dict[str, Any]:
    return {
        "arm": arm.name,
        "base": arm.chain.base,
        "tip": arm.chain.tip,
        "joint_names": list(arm.joint_names),
    }


def _both(kind: str, value: float) -> tuple[str, str]:
    """A joint's value in rad and deg, or in m and mm."""
    if kind == "prismatic":
        return f"{value:.6f} m", f"{value * 1000:.3f} mm"
    return f"{value:.6f} rad", f"{np.rad2deg(value):.3f} deg"


def _row(values: Array) -> str:
    return " ".join(f"{round(value, 9) + 0.0:12.9f}" for value in values)  # Adding zero turns -0 into 0.


def _table(*columns: str) -> Table:
    """A plain table; a column whose name starts with > is set flush right."""
    table = Table(box=None, pad_edge=False, padding=(0, 3, 0, 0))
    for column in columns:
        table.add_column(
            column.removeprefix(">"),
            justify="right" if column.startswith(">") else "left",
            no_wrap=column != "description",
        )
    return table


def _print(what: Table | str) -> None:
    console = Console(highlight=False)
    if isinstance(what, str):
        console.print(what, markup=False, soft_wrap=True)
        return
    console.width = max(console.width, console.measure(what).minimum)  # Numbers are never cut short.
    console.print(what)


def _print_json(facts: dict[str, Any]) -> None:
    print(json.dumps(facts, indent=2, allow_nan=False))
