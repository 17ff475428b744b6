"""Claim 19: is breadth-first search impossible? It finds the same node, and bounds judge partial nodes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import kinseek

from . import plain
from .arms import DIVISIONS, random_goals
from .effort import Effort, Row
from .objects import frame_of
from .style import LOOKS, canvas, save, where
from .sweep import ARMS

ORDERS = ("depth first", "breadth first", "depth first, bounds", "breadth first, bounds")


def cases(effort: Effort) -> list[Row]:
    """The four orders on grids that plain Python can walk."""
    full: dict[int, tuple[int, ...]] = {2: (60, 240), 3: (30,)}
    quick: dict[int, tuple[int, ...]] = {2: (12,)}
    grids = effort.pick(full, quick)
    return [
        {"dof": dof, "branching_factor": size, "order": order}
        for dof, sizes in grids.items()
        for size in sizes
        for order in ORDERS
    ]


def measure(case: Row, effort: Effort) -> Row:
    """Walk the whole grid, or what the bounds leave of it; compare with kinseek's brute force."""
    dof, size, order = case["dof"], case["branching_factor"], case["order"]
    arm, points = kinseek.load(ARMS[dof]), effort.pick(5, 1)
    goals = random_goals(arm, points, effort.seed)
    grid = plain.Grid(plain.ARMS[dof], size, size, (1,) * dof)
    best = arm.ik(goals, solver=kinseek.BruteForce(size)).weighted_error
    start = arm.ik(goals, solver=kinseek.DivideAndConquer(size, DIVISIONS)).weighted_error
    walk = breadth_first if order.startswith("breadth") else depth_first
    expanded = held = same = 0
    for goal, known, least in zip(goals, start, best, strict=True):
        # With bounds, divide and conquer says first what is to be beaten.
        incumbent = float(known) + 1e-9 if order.endswith("bounds") else math.inf
        error, count, most = walk(grid, frame_of(goal), incumbent)
        expanded, held = expanded + count, max(held, most)
        same += abs(error - float(least)) < 1e-9
    return {
        "points": points,
        "nodes_expanded": expanded // points,
        "most_held": held,
        "same_best": same / points,
    }


def bound(grid: plain.Grid, frame: plain.Frame, joint: int, goal: plain.Frame) -> float:
    """What the error is at least once the joints before `joint` are set: the triangle's inequality.

    The next joint stands at a known place. From there the tip is at most the sum of the lengths that are left
    away, and, if one of them is longer than all others together, at least the difference.
    """
    links = grid.arm.links
    here = plain.moved(frame, plain.Link("", links[joint].offset), 0.0)
    away = math.dist(here[:3], goal[:3])
    most = least = 0.0
    spans = [
        (
            math.hypot(*link.offset) if place else 0.0,
            0.0 if link.revolute else max(abs(link.lower), abs(link.upper)),
        )
        for place, link in enumerate(links[joint:])
    ]
    lengths = [length + slide for length, slide in spans] + [math.hypot(*grid.arm.tip)]
    most = sum(lengths)
    if not any(slide for _, slide in spans):
        least = 2 * max(lengths) - most
    turn = 0.0
    if not any(link.revolute for link in links[joint:]):
        # Nothing turns any more: the orientation's part of the error is what it will be.
        turn = plain.error_of((*goal[:3], *frame[3:]), goal)
    return max(0.0, away - most, least - away) + turn


def depth_first(grid: plain.Grid, goal: plain.Frame, incumbent: float) -> tuple[float, int, int]:
    """The least error, the nodes expanded, and the most nodes held at once."""
    bounded, best, expanded, last = math.isfinite(incumbent), incumbent, 0, len(grid.arm.links) - 1

    def down(joint: int, frame: plain.Frame) -> None:
        nonlocal best, expanded
        for index in range(grid.size):
            expanded += 1
            behind = plain.moved(frame, grid.arm.links[joint], grid.value(joint, index))
            if joint == last:
                tip = plain.moved(behind, plain.Link("", grid.arm.tip), 0.0)
                best = min(best, plain.error_of(tip, goal))
            elif not bounded or bound(grid, behind, joint + 1, goal) < best:
                down(joint + 1, behind)

    down(0, plain.BASE)
    return best, expanded, len(grid.arm.links)


def breadth_first(grid: plain.Grid, goal: plain.Frame, incumbent: float) -> tuple[float, int, int]:
    """As `depth_first`, one level after the other: all partial assignments of a level are held."""
    bounded, level, expanded, held = math.isfinite(incumbent), [plain.BASE], 0, 0
    for joint, link in enumerate(grid.arm.links):
        frames = [plain.moved(frame, link, grid.value(joint, i)) for frame in level for i in range(grid.size)]
        expanded, held = expanded + len(frames), max(held, len(frames))
        last = joint == len(grid.arm.links) - 1
        if bounded and not last:
            frames = [frame for frame in frames if bound(grid, frame, joint + 1, goal) < incumbent]
        level = frames
    tips = (plain.moved(frame, plain.Link("", grid.arm.tip), 0.0) for frame in level)
    return min((plain.error_of(tip, goal) for tip in tips), default=incumbent), expanded, held


def draw(rows: Sequence[Row], path: Path) -> None:
    """Nodes expanded and nodes held by each order."""
    grids = sorted({(row["dof"], row["branching_factor"]) for row in rows})
    figure, axes = canvas(1, 2, (10, 4), sharey=True)
    panels = (("nodes_expanded", "nodes expanded per point"), ("most_held", "most nodes held at once"))
    for axis, (name, label) in zip(axes[0], panels, strict=True):
        for number, (look, order) in enumerate(zip(LOOKS, ORDERS, strict=False)):
            some = [where(rows, dof=dof, branching_factor=size, order=order)[0] for dof, size in grids]
            places = [place + 0.1 * (number - 1.5) for place in range(len(grids))]
            axis.plot(places, [row[name] for row in some], label=order, **{**look, "linestyle": "none"})
        axis.set(yscale="log", title=label)
        axis.set_xticks(range(len(grids)), [f"{dof} DOF\nB = {size}" for dof, size in grids])
    axes[0, 1].legend(fontsize=8)
    figure.suptitle("Claim 19: brute force in four orders, the same best node")
    save(figure, path)
