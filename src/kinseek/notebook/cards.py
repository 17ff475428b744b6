"""Arms, solutions, branches and proofs as HTML for notebooks: a table with a picture beside it; every text is escaped."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.printable import in_html

from .picture import Outline, Target, draw

Array = NDArray[np.float64]

HEAD = 10
"""Maximum number of rows of a batch that are shown, and of solutions that are drawn."""
MOST_BODIES, MOST_OUTLINES = 20, 500
"""Maximum number of bodies that are listed, and of shapes that are drawn."""
MOST_JOINTS = 20
"""Maximum number of joints that are shown."""


_TABLE = '<table style="color:inherit">'


def arm_card(arm: Any) -> str:
    """The joints of an arm and their limits, and the arm at the middle of its limits."""
    mechanism = arm.mechanism
    rows = []
    for name, kind, low, high in zip(arm.joint_names, arm.kinds, arm.lower, arm.upper, strict=True):
        ends = ["none", "none"] if kind == "continuous" else [_both(kind, end) for end in (low, high)]
        rows.append([name, kind, *ends])
    middle = (mechanism.lower + mechanism.upper) / 2
    table = _table(["joint", "kind", "lower", "upper"], rows[:MOST_JOINTS]) + _more(
        len(rows) - MOST_JOINTS, "joints"
    )
    return _card(repr(arm), table, _picture(mechanism, middle[None]))


def solution_card(solution: Any) -> str:
    """A solution with its errors, or the first solutions of a batch."""
    if isinstance(solution.success, np.ndarray):
        return _batch_card(solution)
    if solution.invalid:
        return _card(str(solution.status), "", "")
    problem = solution.problem
    table = _joints(problem.mechanism, solution.q) + _facts(
        [*_errors(problem.goal, solution), ("FK evaluations", f"{solution.evaluations:,}")]
    )
    return _card(str(solution.status), table, _picture(problem.mechanism, solution.q[None], problem.goal))


def _batch_card(solution: Any) -> str:
    names = solution.problem.mechanism.joint_names
    flat = solution.q.reshape(-1, len(names))
    columns = [
        np.ravel(each) for each in (solution.status, solution.position_error, solution.orientation_error)
    ]
    rows = [
        [
            _place(i, solution.success.shape),
            status.name,
            *map(_short, q[:MOST_JOINTS]),
            f"{place:.1e}",
            f"{turn:.1e}",
        ]
        for i, (q, status, place, turn) in enumerate(zip(flat[:HEAD], *columns, strict=False))
    ]
    head = ["", "status", *names[:MOST_JOINTS], "position error [m]", "orientation error [rad]"]
    return _card(repr(solution), _table(head, rows) + _more(len(flat) - HEAD, "targets"), "")


def branches_card(branches: Any) -> str:
    """The first solutions of one goal, and the arm at all of these."""
    names = branches.problem.mechanism.joint_names
    rows = [
        [str(i), *map(_short, q[:MOST_JOINTS]), f"{place:.1e}"]
        for i, (q, place) in enumerate(zip(branches.q[:HEAD], branches.position_error, strict=False))
    ]
    table = _table(["", *names[:MOST_JOINTS], "position error [m]"], rows) + _more(
        len(branches) - HEAD, "solutions"
    )
    picture = _picture(branches.problem.mechanism, branches.q[:HEAD], branches.problem.goal)
    return _card(repr(branches), table, picture)


def branches_batch_card(batch: Any) -> str:
    """The number of solutions of the first goals."""
    rows = [
        [
            _place(i, batch.shape),
            str(len(one)),
            "yes" if one.complete else "not proved",
            "yes" if one.sampled else "no",
        ]
        for i, one in enumerate(batch.each[:HEAD])
    ]
    table = _table(["", "solutions", "complete", "a sample"], rows) + _more(len(batch) - HEAD, "goals")
    return _card(repr(batch), table, "")


def certificate_card(certificate: Any) -> str:
    """The verdict, the bounds, and the best joint values found."""
    problem = certificate.problem
    facts = [
        ("weighted error of any pose", f"at least {certificate.lower_bound:.6g}"),
        ("weighted error of this one", f"{certificate.upper_bound:.6g}"),
        *_errors(problem.goal, certificate),
        ("boxes examined", f"{certificate.boxes:,}"),
    ]
    table = _joints(problem.mechanism, certificate.q) + _facts(facts)
    picture = _picture(problem.mechanism, certificate.q[None], problem.goal)
    return _card(str(certificate.verdict), table, picture)


def scene_card(scene: Any, chain: Any, q: Array, bodies: Sequence[Any], hit: Collection[str]) -> str:
    """The bodies of a scene, and the arm among them, with those in red that touch there.

    Args:
        scene: The scene.
        chain: Its arm.
        q: Joint values, (n,), [rad] or [m].
        bodies: Its bodies there, `collision.surfaces.Outlined`.
        hit: Names of those that touch.
    """
    shown = [body for body in bodies if body.kind != "link" or body.name in hit]
    rows = [
        [body.name, body.kind, body.shapes, "touches" if body.name in hit else ""]
        for body in shown[:MOST_BODIES]
    ]
    table = _table(["body", "kind", "shapes", ""], rows) + _more(len(shown) - MOST_BODIES, "bodies")
    outlines = [Outline(corners, body.name in hit) for body in shown for corners in body.corners]
    picture = draw(chain, q[None], bodies=outlines[:MOST_OUTLINES])
    return _card(repr(scene).partition("\n")[0], table, picture)


def _picture(mechanism: Any, rows: Array, goal: Any = None) -> str:
    """Draw the arm at joint values, (k, n); "" without joint values, or for black-box kinematics with unknown links."""
    if mechanism.axes is None or not len(rows):
        return ""
    tool = None if goal is None else goal.tool
    return draw(mechanism.axes, rows, tool, None if goal is None else _target(goal))


def _target(goal: Any) -> Target:
    place = goal.targets[0]
    counted: list[tuple[int, Array]] = []
    if goal.form.turned:  # The compared axis is mapped to x.
        counted = [(int(np.argmax(np.abs(goal.tool_axis))), place[:, 0])]
    elif goal.form.columns:
        counted = [(i, place[:, i]) for i in range(3) if not goal.free or f"r{'xyz'[i]}" not in goal.free]
    return Target(place[:, 3], counted)


def _joints(mechanism: Any, q: Array) -> str:
    rows = []
    for name, kind, value, low, high in zip(
        mechanism.joint_names, mechanism.kinds, q, mechanism.lower, mechanism.upper, strict=True
    ):
        bar = "no limits" if kind == "continuous" else _bar(value, low, high)
        rows.append([name, _short(value), _other(kind, value), bar])
    table = _table(["joint", "rad or m", "deg or mm", "in its limits"], rows[:MOST_JOINTS], plain=3)
    return table + _more(len(rows) - MOST_JOINTS, "joints")


def _errors(goal: Any, solution: Any) -> list[tuple[str, str]]:
    place = ("position error", f"{solution.position_error:.2g} m of {goal.position_tolerance:g} m")
    turn = (
        f"{solution.orientation_error:.2g} rad of {goal.orientation_tolerance:g} rad"
        if goal.form.columns
        else "any"
    )
    return [place, ("orientation error", turn)]


def _bar(value: float, low: float, high: float) -> str:
    """Draw a line between the limits with a dot at the value."""
    share = (value - low) / (high - low) if high > low else 0.5
    return (
        f'<svg width="84" height="10" fill="currentColor"><title>{low:.4g} to {high:.4g}</title>'
        f'<rect x="4" y="4" width="76" height="2" opacity="0.35"/>'
        f'<circle cx="{4 + 76 * min(max(share, 0.0), 1.0):.1f}" cy="5" r="4"/></svg>'
    )


def _card(title: str, table: str, picture: str) -> str:
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:1.5em;align-items:center;max-width:100%">'
        f'<div style="overflow-x:auto"><div style="margin-bottom:0.4em"><b>{in_html(title)}</b></div>{table}</div>'
        f"<div>{picture}</div></div>"
    )


def _table(head: Sequence[str], rows: Iterable[Sequence[str]], plain: int = -1) -> str:
    """Make a table; the cells of the column `plain` are HTML already."""
    lines = "".join(
        "<tr>"
        + "".join(f"<td>{cell if i == plain else in_html(cell)}</td>" for i, cell in enumerate(row))
        + "</tr>"
        for row in rows
    )
    names = "".join(f"<th>{in_html(name)}</th>" for name in head)
    return f"{_TABLE}<thead><tr>{names}</tr></thead><tbody>{lines}</tbody></table>"


def _facts(facts: Iterable[tuple[str, str]]) -> str:
    lines = "".join(f"<tr><td>{in_html(what)}</td><td>{in_html(said)}</td></tr>" for what, said in facts)
    return f"{_TABLE}<tbody>{lines}</tbody></table>"


def _more(count: int, noun: str) -> str:
    return f"<div>and {count:,} more {noun}</div>" if count > 0 else ""


def _place(number: int, shape: tuple[int, ...]) -> str:
    return ", ".join(str(i) for i in np.unravel_index(number, shape))


def _short(value: float) -> str:
    return f"{value:.4f}"


def _other(kind: str, value: float) -> str:
    if kind == "prismatic":
        return f"{value * 1000:.2f}"
    return "" if kind == "number" else f"{math.degrees(value):.2f}"


def _both(kind: str, value: float) -> str:
    unit = {"prismatic": " m", "number": ""}.get(kind, f" rad = {math.degrees(value):.4g}°")
    return f"{value:.4g}{unit}"
