"""The texts of a page as HTML: the solution, the joints and their limits, the passes of a search."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.arm import Arm
from kinseek.branches.result import Branches
from kinseek.collision import Box
from kinseek.collision.pairs import Contact
from kinseek.collision.surfaces import DrawnBody
from kinseek.paths.tracker import Step, TrackStatus
from kinseek.poses import rpy_of
from kinseek.printable import in_html
from kinseek.robots.mechanism import CONTINUOUS, PRISMATIC, REVOLUTE
from kinseek.timing.trajectory import Trajectory
from kinseek.trace import Pass, Trace

from .session import GoalResult, Planned, Proof, status_of

Array = NDArray[np.float64]

_NEWS = {"good": "#2b8a3e", "bad": "#c92a2a", "open": "#b35c00", "refused": "#c92a2a"}
_SOFT = "color:var(--mantine-color-dimmed)"
MOST_CONTACTS = 6
"""Maximum number of contacts that are named."""
_NEAR = 0.02
"""Fraction of a joint's range within which a value near a limit is highlighted."""


def result_html(result: GoalResult, proof: Proof | None, proving: bool) -> str:
    """The status sentence, both errors, the work, and what is proved; `proving` announces that more may follow."""
    parts = [_sentence(*status_of(result, proof))]
    if result.solution is not None:
        found = result.solution
        turn = float(found.orientation_error)
        rows = [
            ("position error", f"{float(found.position_error):.3g} m"),
            ("orientation error", f"{turn:.3g} rad ({np.degrees(turn):.3g}°)"),
            ("work", f"{int(found.evaluations):,} FK evaluations{_time(result.seconds)}"),
        ]
        parts.append(_table(rows))
    said = proof.sentences() if proof is not None else []
    if proving:
        said.append("Looking closer …" if said else "Looking for a proof …")
    parts += [f"<div style='margin-top:4px'>{in_html(each)}</div>" for each in said]
    return _block("".join(parts))


def _table(rows: list[tuple[str, str]]) -> str:
    cells = "".join(
        f"<tr><td style='{_SOFT};padding-right:10px'>{name}</td><td>{value}</td></tr>" for name, value in rows
    )
    return f"<table style='margin-top:4px;border-spacing:0;font-variant-numeric:tabular-nums'>{cells}</table>"


def contacts_html(contacts: Sequence[Contact]) -> str:
    """What touches, or comes too near, where the arm is shown."""
    if not contacts:
        return ""
    more = len(contacts) - MOST_CONTACTS
    lines = [in_html(str(one)) for one in contacts[:MOST_CONTACTS]] + (
        [f"and {more} more"] if more > 0 else []
    )
    hit = "".join(f"<div>{line}</div>" for line in lines)
    return _block(f"<div style='color:#c92a2a' data-contacts='{len(contacts)}'>Hit: {hit}</div>")


def servo_html(step: Step) -> str:
    """The status of a tracker, both errors, what limits it, and the bodies before which it brakes."""
    turn = step.orientation_error
    rows = [
        ("position error", f"{step.position_error:.3g} m"),
        ("orientation error", f"{turn:.3g} rad ({np.degrees(turn):.3g}°)"),
        (
            "limited by",
            "nothing" if step.limited is None else f"{step.limited[1]} of {in_html(step.limited[0])}",
        ),
    ]
    if step.obstacle is not None:
        a, b, distance = step.obstacle
        rows.append(("brakes before", f"{in_html(a)} and {in_html(b)}, {distance * 1e3:.1f} mm apart"))
    news = "good" if step.status is TrackStatus.TRACKING else "open"
    return _block(_sentence(str(step.status), news) + _table(rows))


def shares_html(arm: Arm, shares: Array) -> str:
    """Every joint's shares of its limits of velocity and acceleration, (2, n), as bars; orange at the limit."""
    name_style = "flex:0 0 34%;overflow:hidden;text-overflow:ellipsis;white-space:nowrap"
    rows = [
        f"<div style='display:flex;gap:6px;{_SOFT}'><span style='{name_style}'></span>velocity, acceleration</div>"
    ]
    for name, of_joint in zip(arm.joint_names, shares.T, strict=True):
        bars = "".join(
            f"<span style='flex:1 1 0;height:8px;background:rgba(128,128,128,.25)'><span style='display:block;height:8px;"
            f"width:{100 * min(share, 1.0):.0f}%;background:{'#e8590c' if share > 0.999 else '#1c7ed6'}'></span></span>"
            for share in of_joint
        )
        rows.append(
            f"<div style='display:flex;align-items:center;gap:6px'>"
            f"<span style='{name_style}'>{in_html(name)}</span>{bars}</div>"
        )
    return _block(f"<div data-shares='{len(arm.joint_names)}'>{''.join(rows)}</div>")


def refused_html(why: str) -> str:
    """Why a goal is rejected."""
    return _block(_sentence(why, "refused"))


def _sentence(words: str, news: str) -> str:
    return (
        f"<div style='border-left:4px solid {_NEWS[news]};padding:2px 0 2px 8px;font-weight:600' "
        f"data-status='{news}' role='status'>{in_html(words)}</div>"
    )


def _time(seconds: float) -> str:
    if not seconds:
        return ""
    if seconds < 1e-3:
        return f", {seconds * 1e6:.0f} µs"
    return f", {seconds * 1e3:.3g} ms" if seconds < 0.9995 else f", {seconds:.3g} s"


def branches_html(branches: Branches | str | None, shown: int, drawn: int, free: int | None = None) -> str:
    """The number of solutions, which of them is shown, and in a scene how many are free."""
    if branches is None:
        text = "Branches: looking …"
    elif isinstance(branches, str):
        text = f"No branches: {branches}"
    elif not len(branches):
        text = "Branches: none found."
    else:
        count = f"{len(branches)} branch{'es' if len(branches) > 1 else ''}"
        text = count if shown < 0 else f"Branch {shown + 1} of {len(branches)}"
        text += ", a sample of infinitely many" if branches.sampled else ""
        text += "" if free is None else f"; {free} free"
        text += f"; {drawn} drawn." if drawn < len(branches) else "."
    return _block(f"<div style='{_SOFT}'>{in_html(text)}</div>")


def joints_html(arm: Arm, q: Array, window: Pass | None = None) -> str:
    """Every joint as a bar between its limits, with a mark at its value, and the window of a pass on it.

    Args:
        arm: The arm.
        q: Joint values, (n,), [rad] or [m].
        window: A pass of a search: the part of each range that it searched.
    """
    rows = []
    for i, (name, kind) in enumerate(zip(arm.joint_names, arm.kinds, strict=True)):
        low, high = float(arm.lower[i]), float(arm.upper[i])
        part = (float(q[i]) - low) / (high - low) if high > low else 0.5
        mark = 100 * min(max(part, 0.0), 1.0)
        tight = kind != CONTINUOUS and min(part, 1.0 - part) < _NEAR
        colour = "#e8590c" if tight else "#1c7ed6"
        band = "" if window is None else _band(window, i, low, high)
        ends = (
            ""
            if kind == CONTINUOUS
            else "border-left:2px solid;border-right:2px solid;border-color:currentColor;"
        )
        limits = "turns without end" if kind == CONTINUOUS else f"{joint(low, kind)} to {joint(high, kind)}"
        rows.append(
            f"<div style='display:flex;align-items:center;gap:6px;margin:3px 0' title='{in_html(name)}: {limits}'>"
            f"<span style='flex:0 0 34%;overflow:hidden;text-overflow:ellipsis;white-space:nowrap;direction:rtl;"
            f"text-align:left'>&lrm;{in_html(name)}</span>"
            f"<span style='position:relative;flex:1 1 auto;height:10px;{ends}"
            f"background:rgba(128,128,128,.25)'>{band}"
            f"<span style='position:absolute;left:calc({mark:.2f}% - 2px);top:-2px;width:4px;height:14px;"
            f"background:{colour};border-radius:2px'></span></span>"
            f"<span style='flex:0 0 4.6em;text-align:right;font-variant-numeric:tabular-nums'>{joint(float(q[i]), kind)}"
            f"</span></div>"
        )
    return _block(f"<div data-joints='{len(rows)}' style='padding-bottom:8px'>{''.join(rows)}</div>")


def _band(window: Pass, i: int, low: float, high: float) -> str:
    """The window of a pass on a joint's bar, in two parts if it wraps around."""
    if window.lower is None or window.upper is None or high <= low:
        return ""
    begin, end = (window.lower[i] - low) / (high - low), (window.upper[i] - low) / (high - low)
    if end - begin >= 1.0:
        pieces = [(0.0, 1.0)]
    else:
        pieces = [(begin + k, end + k) for k in (-1, 0, 1)]
        pieces = [(max(a, 0.0), min(b, 1.0)) for a, b in pieces if b > 0.0 and a < 1.0]
    return "".join(
        f"<span style='position:absolute;left:{100 * a:.2f}%;width:max({100 * (b - a):.2f}%,2px);height:100%;"
        f"background:rgba(230,119,0,.55)'></span>"
        for a, b in pieces
    )


def joint(value: float, kind: str) -> str:
    """Format a joint value in degrees, in millimetres, or as a plain number."""
    if kind in (REVOLUTE, CONTINUOUS):
        return f"{round(float(np.degrees(value)), 1) + 0.0:.1f}°"  # Adding 0 removes the sign of -0.
    return f"{round(value * 1e3, 1) + 0.0:.1f} mm" if kind == PRISMATIC else f"{value:.4g}"


def pass_html(trace: Trace | None, number: int) -> str:
    """Describe one pass of a search, by its index from 0."""
    if trace is None or not len(trace):
        return _block(f"<div style='{_SOFT}'>This search recorded no passes.</div>")
    one, spent = trace[number], int(trace.evaluations[number])
    lines = [
        f"<b>{in_html(one.name)}</b> ({number + 1} of {len(trace)})",
        f"best so far {one.position_error:.3g} m, {one.orientation_error:.3g} rad",
        f"{one.evaluations:,} FK evaluations, {spent:,} so far",
    ]
    if one.counts is not None:
        least, most = int(one.counts.min()), int(one.counts.max())
        lines.append(
            f"{least if least == most else f'{least} to {most}'} values a joint, {one.cells:,} windows"
            if one.cells > 1
            else f"{least if least == most else f'{least} to {most}'} values a joint"
        )
    return _block("".join(f"<div data-pass='{number}'>{line}</div>" for line in lines))


def code_html(*lines: str) -> str:
    """Lines of Python code."""
    code = "\n".join(map(in_html, lines))
    return _block(f"<code style='white-space:pre-wrap;overflow-wrap:anywhere;font-size:11px'>{code}</code>")


def changes_of(before: Iterable[DrawnBody], after: Iterable[DrawnBody]) -> list[str]:
    """Return lines of Python that make the same changes of a scene: bodies that were removed, added, moved or resized."""
    known = {body.name: body for body in before}
    now = {body.name: body for body in after}
    lines = [f"scene.remove({name!r})" for name, body in known.items() if body.alone and name not in now]
    for name, body in now.items():
        old = known.get(name)
        if old is body:
            continue
        same = old is not None and old.parts[0].shape == body.parts[0].shape
        if same and old is not None and (old.frame.pose == body.frame.pose).all():
            continue
        T, shape = body.frame.pose, body.parts[0].shape
        place = f"kinseek.pose({_rounded(T[:3, 3])}, rpy={_rounded(rpy_of(T[:3, :3]))})"
        if body.is_box and isinstance(shape, Box) and old is None:
            lines.append(f"scene.add_box({name!r}, {_rounded(shape.size)}, {place})")
            continue
        if body.is_box and isinstance(shape, Box):
            given, why = f"kinseek.collision.Box({_rounded(shape.size)})", ""
        else:  # Not runnable as it is, since the program would have the body at its old place.
            given, why = "...", "  # in place of ..., its own shape"
        lines.append(f"scene.add({name!r}, {given}, {place}, replace=True){why}")
    return lines


def _rounded(numbers: ArrayLike) -> list[float]:
    return [round(float(each), 9) + 0.0 for each in np.asarray(numbers)]


def plan_html(planned: Planned) -> str:
    """What came of a plan."""
    return _block(_sentence(planned.said, planned.news))


def motion_html(trajectory: Trajectory, t: float) -> str:
    """What a motion does at a time [s]: the speed of the tip, and the limit that caps the speed."""
    parts = [f"{t:.3f} of {trajectory.duration:.3f} s"]
    if trajectory.mechanism.axes is not None:
        parts.append(f"tip {float(trajectory.tip_speed(t)):.3f} m/s")
    for cap in trajectory.bottleneck:
        if cap.begin <= t <= cap.end:
            what = "the tool speed" if cap.joint is None else f"the {cap.limit} of {cap.joint}"
            parts.append(f"capped by {what}")
            break
    return note_html("; ".join(parts))


def note_html(*sentences: str) -> str:
    """Sentences in small print."""
    return _block("".join(f"<div style='{_SOFT}'>{in_html(each)}</div>" for each in sentences if each))


def _block(inner: str) -> str:
    return f"<div style='font-size:13px;line-height:1.45;padding:2px 10px'>{inner}</div>"
