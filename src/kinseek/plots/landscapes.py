"""Landscapes of the error over two joints, and the progress of a search towards its solution."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.errors import InvalidUse
from kinseek.problem import as_joints
from kinseek.solution import Solution, judge
from kinseek.trace import Pass

from .figures import COLOURS, drawn, given_or_new, plane, pyplot
from .shown import axis_label, count_of, judged, trace_of, two_joints, unit_of, with_windows

Array = NDArray[np.float64]
Pair = tuple[int | str, int | str]

POINTS = 241
"""Default number of values of each joint at which a landscape of errors is computed."""

LEAST_ERROR = 1e-12
"""Lower end of a logarithmic axis of errors: smaller errors are rounding."""

MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")

LOG_ERROR = "log10 of the weighted error"

MOST_NODES = 2500
"""Maximum number of nodes of a pass that is drawn; more cannot be distinguished."""


@drawn
def landscape(
    solution: Solution,
    joints: Pair = (0, 1),
    *,
    solutions: ArrayLike | None = None,
    within: ArrayLike | None = None,
    points: int = POINTS,
    ax: Any = None,
    size: tuple[float, float] = (5.6, 4.6),
) -> Any:
    """Draw the weighted error over the ranges of two joints: darker is nearer to the goal.

    All other joints have their values in the solution. The solution is drawn as a cross, other solutions as circles.

    Args:
        solution: Solution of one target.
        joints: The two joints, by index from 0 or by name.
        solutions: Other joint values to mark, (k, n), such as those of `arm.branches`.
        within: Lowest and highest values of the first joint and of the second, (2, 2); by default their whole ranges.
        points: Number of values of each joint; points² errors are computed.
        ax: Axes in a plane to draw on; a new figure also has a colour bar.
        size: Size of a new figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidProblem: `solutions` do not fit the arm.
        InvalidUse: A batch, not two joints of the arm, ends in the wrong order, too few points, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    one, points = judged(solution), count_of("points", points, 2)
    mechanism = one.problem.mechanism
    x, y = two_joints(mechanism.joint_names, joints)
    others = np.empty((0, mechanism.dof))
    if solutions is not None:
        others = np.atleast_2d(as_joints(mechanism, solutions, "solutions"))
    figure, axes = given_or_new(ax, size)
    low, high = np.array(one.problem.limits)[:, [x, y]] if within is None else _ends(within)
    image = _shade(axes, one, (x, y), low, high, points, "viridis")
    # The deepest hundredth, some dots around a solution, would take most of the colours.
    image.set_clim(vmin=float(np.percentile(np.asarray(image.get_array()), 1)))
    if ax is None:
        figure.colorbar(image, ax=axes, label=LOG_ERROR, pad=0.01, extend="min")
    dots = {"linestyle": "none", "markeredgecolor": "black", "markerfacecolor": "white", "zorder": 4}
    axes.plot(*others[:, [x, y]].T, MARKS[0], markersize=7, **dots)
    _cross(axes, np.asarray(one.q)[[x, y]])
    _name_axes(axes, one, x, y)
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure


@drawn
def passes(
    solution: Solution,
    joints: Pair = (0, 1),
    *,
    first: int = 6,
    points: int = 121,
    panel: float = 2.7,
) -> Any:
    """Draw the nodes of a grid search, pass by pass: each panel is the window of a pass with all of its nodes.

    The colour of a node is its weighted error. A ring marks the best joint values known after the pass, and a frame the
    window of the next pass, which the next panel shows. All other joints have the values of the pass's best, for the nodes
    and for the landscape behind them. For an arm with two joints the nodes are all that were visited; with a beam they are
    those of the window around the best.

    Args:
        solution: Solution of one target, with its trace.
        joints: The two joints, by index from 0 or by name.
        first: Maximum number of passes.
        points: Number of values of each joint at which the landscape behind the nodes is computed; points² errors are
            computed for each panel, and one for each node.
        panel: Size of each panel [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: No trace, a batch, not two joints of the arm, no pass with a window, a window with too many nodes to
            distinguish, or less than one panel or two points.
        MissingExtra: Matplotlib is not installed.
    """
    trace = trace_of(judged(solution))
    x, y = two_joints(trace.joint_names, joints)
    first, points = count_of("first", first, 1), count_of("points", points, 2)
    both = [each for each in with_windows(trace) if len(each.values(x)) > 1 and len(each.values(y)) > 1]
    shown = both[:first]
    if not shown:
        raise InvalidUse(f"no pass of this {trace.search} tries values of both joints")
    for each in shown:
        nodes = len(each.values(x)) * len(each.values(y))
        if nodes > MOST_NODES:
            raise InvalidUse(
                f"{each.name!r} has {nodes:,} nodes in this plane, at most {MOST_NODES:,} can be distinguished; "
                "choose fewer divisions"
            )
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    figure, axes = plane(columns, rows=rows, size=(panel * columns + 1.1, (panel + 0.35) * rows))
    panels = np.ravel(axes)
    errors = [_nodes(solution, each, x, y) for each in shown]
    low, high = min(each.min() for each in errors), max(each.max() for each in errors)
    image = None
    for i, (each, ax) in enumerate(zip(shown, panels, strict=False)):
        following = both[i + 1] if i + 1 < len(both) else None
        start, end = _around(solution, each, following, x, y)
        at = replace(solution, q=each.q)
        image = _shade(ax, at, (x, y), start, end, points, "viridis", (low, high))
        values = np.meshgrid(each.values(x), each.values(y), indexing="ij")
        look = {"cmap": "viridis", "vmin": low, "vmax": high, "edgecolors": "white", "linewidths": 0.8}
        room = panel * 72 / max(len(each.values(x)), len(each.values(y)))
        ax.scatter(*values, c=errors[i], s=min(42.0, (0.5 * room) ** 2), **look)
        ax.plot(
            *each.q[[x, y]],
            MARKS[0],
            markersize=11,
            markerfacecolor="none",
            markeredgecolor=COLOURS[1],
            mew=2,
        )
        if following is not None:
            _frame(ax, solution, following, x, y, edgecolor="black", linewidth=1.4)
        spacing = each.spacing
        apart = (
            "" if spacing is None else f"\n{errors[i].size} nodes, {_spacings(solution, spacing, x, y)} apart"
        )
        ax.set_title(f"{each.name}{apart}")
        ax.set(xlim=(start[0], end[0]), ylim=(start[1], end[1]))
        ax.grid(False)
        ax.locator_params(nbins=4)
        if i % columns == 0:
            ax.set_ylabel(_label(solution, y))
        if i >= len(shown) - columns:
            ax.set_xlabel(_label(solution, x))
    for ax in panels[len(shown) :]:
        ax.set_visible(False)
    figure.colorbar(image, ax=list(panels), label=LOG_ERROR, pad=0.01, aspect=30)
    return figure


@drawn
def windows(
    solution: Solution,
    joints: Pair = (0, 1),
    *,
    points: int = POINTS,
    size: tuple[float, float] = (8.6, 4.2),
) -> Any:
    """Draw how the windows of the passes shrink around the solution, over the landscape of the weighted error.

    The left side shows the whole ranges of two joints, the right side the neighbourhood of the solution, a cross. All other
    joints have their values in the solution. A frame is a window, a dot the best known after its pass, and darker is nearer
    to the goal. Windows too small to see are left out.

    Args:
        solution: Solution of one target, with its trace.
        joints: The two joints, by index from 0 or by name.
        points: Number of values of each joint at which the landscape is computed; 2 points² errors are computed.
        size: Size of the figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: No trace, a batch, not two joints of the arm, no pass with a window, or too few points.
        MissingExtra: Matplotlib is not installed.
    """
    trace, points = trace_of(judged(solution)), count_of("points", points, 2)
    x, y = two_joints(trace.joint_names, joints)
    shown = with_windows(trace)
    lower, upper = solution.problem.limits
    figure, axes = plane(2, size=size)
    best_q = np.asarray(solution.q)
    centre, half = best_q[[x, y]], (upper - lower)[[x, y]] / 2
    # The right panel shows the fourth window, or the last: about a ninth of the second.
    near = shown[min(3, len(shown) - 1)]
    close = np.maximum(np.subtract(*near.ends[::-1])[[x, y]] * 1.5, 1e-9)
    boxes = [
        (lower[[x, y]], upper[[x, y]]),
        (centre - np.minimum(close, half), centre + np.minimum(close, half)),
    ]
    for each, (low, high) in zip(axes, boxes, strict=True):
        image = _shade(each, solution, (x, y), low, high, points, _greys())
        for i, pass_ in enumerate(shown):
            start, end = (each_end[[x, y]] for each_end in pass_.ends)
            wide = end - start
            if (wide < (high - low) / 60).any() or i == 6:  # As many colours as are distinct on grey.
                break
            colour = COLOURS[i % 6]
            _frame(each, solution, pass_, x, y, edgecolor=colour, linewidth=1.6)
            each.plot(
                *pass_.q[[x, y]],
                MARKS[0],
                color=colour,
                markeredgecolor="black",
                markersize=6,
                zorder=4,
                label=pass_.name,
            )
        _cross(each, centre)
        each.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        _name_axes(each, solution, x, y)
        figure.colorbar(image, ax=each, label=LOG_ERROR, pad=0.01)
    handles = {
        label: handle
        for each in axes
        for handle, label in zip(*each.get_legend_handles_labels(), strict=True)
    }
    figure.legend(
        handles.values(),
        handles.keys(),
        loc="outside upper center",
        ncols=min(8, len(handles)),
        frameon=False,
    )
    return figure


def errors_at(solution: Solution, q: Array) -> Array:
    """Return the weighted errors at joint values, (k, n) -> (k,)."""
    problem = solution.problem
    target = np.broadcast_to(problem.goal.target, (len(q), 4, 4))
    many = replace(problem, goal=problem.goal.at(target), near=None, trace=False)
    return np.asarray(judge(many, q)[:, 2])


def _over(solution: Solution, joints: tuple[int, int], first: Array, second: Array) -> Array:
    """Log10 of the weighted error at all pairs of values of two joints, (k,) and (l,) -> (l, k)."""
    q = np.repeat(np.asarray(solution.q)[None], len(first) * len(second), axis=0)
    q[:, joints[0]], q[:, joints[1]] = np.tile(first, len(second)), np.repeat(second, len(first))
    logs: Array = np.log10(np.maximum(errors_at(solution, q), LEAST_ERROR)).reshape(len(second), len(first))
    return logs


def _nodes(solution: Solution, each: Pass, x: int, y: int) -> Array:
    """Log10 of the weighted error at the nodes of a pass, with the other joints as in its best."""
    return _over(replace(solution, q=each.q), (x, y), each.values(x), each.values(y)).T


def _shade(
    axes: Any,
    solution: Solution,
    joints: tuple[int, int],
    low: Array,
    high: Array,
    points: int,
    colours: Any,
    ends: tuple[float, float] | tuple[None, None] = (None, None),
) -> Any:
    """Colour a part of the plane of two joints by the weighted error there."""
    first, second = (np.linspace(low[i], high[i], points) for i in range(2))
    errors = _over(solution, joints, first, second)
    look = {"vmin": ends[0], "vmax": ends[1], "shading": "nearest", "rasterized": True}
    return axes.pcolormesh(first, second, errors, cmap=colours, **look)


def _ends(within: ArrayLike) -> tuple[Array, Array]:
    """Lowest and highest values of both joints, (2,) each."""
    ends = np.asarray(within, dtype=float)
    if ends.shape != (2, 2) or not np.isfinite(ends).all() or not (ends[:, 0] < ends[:, 1]).all():
        raise InvalidUse(
            f"within must be two pairs of increasing values, (low, high) of each joint; got {within!r}"
        )
    return ends[:, 0], ends[:, 1]


def _around(solution: Solution, each: Pass, following: Pass | None, x: int, y: int) -> tuple[Array, Array]:
    """Return the lowest and highest values of a panel, (2,) each: the window, and the part of the next one beyond it."""
    low, high = np.array(each.ends)[:, [x, y]]
    ends = [(low, high)]
    if following is not None:
        start, end = np.array(following.ends)[:, [x, y]]
        ends += [
            (start + turn, end + turn)
            for turn in _turns(solution, (x, y))
            if (start + turn <= each.q[[x, y]]).all() and (end + turn >= each.q[[x, y]]).all()
        ]
    start, end = np.min([one[0] for one in ends], axis=0), np.max([one[1] for one in ends], axis=0)
    return start - 0.06 * (end - start), end + 0.06 * (end - start)


def _greys() -> Any:
    """Return greys from dark to light, with enough contrast to coloured lines."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("greys", ["0.3", "0.97"])


def _cross(axes: Any, place: Array) -> None:
    """Mark a solution, visible on any background."""
    axes.plot(*place, "x", color="white", markeredgewidth=4, markersize=9, zorder=5)
    axes.plot(*place, "x", color="black", markeredgewidth=1.8, markersize=8, zorder=6)


def _frame(axes: Any, solution: Solution, each: Pass, x: int, y: int, **look: Any) -> None:
    """Draw the window of a pass; for a joint with a full turn, at both ends of its range."""
    start, end = (each_end[[x, y]] for each_end in each.ends)
    for turn in _turns(solution, (x, y)):
        axes.add_patch(pyplot().Rectangle(start + turn, *(end - start), fill=False, **look))


def _turns(solution: Solution, joints: tuple[int, int]) -> list[Array]:
    """Return the shifts with which a window is seen at both ends of the range of a joint with a full turn."""
    wraps, lower, upper = solution.problem.mechanism.wraps, *solution.problem.limits
    ways = [(-1, 0, 1) if wraps[joint] else (0,) for joint in joints]
    full = [upper[joint] - lower[joint] for joint in joints]
    return [np.array([i * full[0], k * full[1]]) for i in ways[0] for k in ways[1]]


def _name_axes(axes: Any, solution: Solution, x: int, y: int) -> None:
    axes.set(xlabel=_label(solution, x), ylabel=_label(solution, y))
    axes.grid(False)


def _spacings(solution: Solution, spacing: Array, x: int, y: int) -> str:
    """Return the distances of neighbouring nodes along two joints, with units."""
    kinds = solution.problem.mechanism.kinds
    report = [f"{spacing[i]:.2g} {unit_of(kinds[i])}".rstrip() for i in (x, y)]
    return report[0] if report[0] == report[1] else f"{report[0]} and {report[1]}"


def _label(solution: Solution, joint: int) -> str:
    mechanism = solution.problem.mechanism
    return axis_label(mechanism.joint_names[joint], mechanism.kinds[joint])
