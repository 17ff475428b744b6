"""Pictures of what searches did, from their traces: Figures 1 to 3 of the paper, and searches side by side."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse
from kinseek.solution import Solution, judge
from kinseek.trace import Pass, Trace

from .arms import COLOURS, plane, pyplot
from .shown import joint_of, judged, named, pass_of, trace_of, turning, with_windows

Array = NDArray[np.float64]

MOST_LEAVES = 1000
"""Of a tree that is drawn."""

FINE = 241
"""Values of each joint at which a landscape of errors is measured."""

LEAST_ERROR = 1e-12
"""Where a logarithmic axis of errors ends: less is rounding."""

MARKS = ("o", "s", "^", "D", "v", "P", "X", "*")


def progress(
    traces: Mapping[str, Trace | Solution] | Sequence[Trace | Solution],
    error: str = "weighted",
    size: tuple[float, float] = (6.4, 4.2),
) -> tuple[Any, Any]:
    """Draw the error of the best known against the FK evaluations spent, of any searches side by side.

    A mark is the end of a pass, or of some where they are many; no evaluations at all are drawn as one.

    Args:
        traces: Of single targets, or solutions that have them: by name, or in a sequence, where each is called what its
            search is called.
        error: ``"weighted"``, ``"position"`` [m] or ``"orientation"`` [rad].
        size: Of the figure [inch].

    Raises:
        InvalidUse: No traces, a batch, or an unknown error.
        MissingExtra: Matplotlib is not installed.
    """
    names = {
        "weighted": "weighted error",
        "position": "position error [m]",
        "orientation": "angle error [rad]",
    }
    if error not in names:
        raise InvalidUse(f"error must be one of {', '.join(names)}; got {error!r}")
    drawn = named(traces)
    figure, axes = plane(size=size)
    for i, (name, trace) in enumerate(drawn.items()):
        errors = np.maximum(getattr(trace, f"{error}_errors"), LEAST_ERROR)
        spent, look = np.maximum(trace.evaluations, 1), {"color": COLOURS[i % len(COLOURS)]}
        axes.plot(spent, errors, drawstyle="steps-post", linewidth=1.4, **look)
        every = max(1, len(spent) // 12)
        marked = np.unique([*range(0, len(spent), every), len(spent) - 1]) if len(spent) else np.arange(0)
        axes.plot(spent[marked], errors[marked], MARKS[i % len(MARKS)], markersize=5, label=name, **look)
    axes.set(xscale="log", yscale="log", xlabel="FK evaluations", ylabel=f"{names[error]} of the best known")
    figure.legend(loc="outside upper center", ncols=min(3, len(drawn)), frameon=False)
    return figure, axes


def tree(solution: Solution, number: int = 1, size: tuple[float, float] = (7.2, 3.6)) -> tuple[Any, Any]:
    """Draw the search tree of one pass over a grid, as Fig. 1 of the paper: a level for each joint, a leaf for each node.

    The leaves have the colour of their weighted error, and the way to the best of them is drawn bold.

    Args:
        solution: Of one target, with its trace.
        number: Of the pass, from 1 on.
        size: Of the figure [inch].

    Raises:
        InvalidUse: No trace, a batch, a pass without a window, or more leaves than can be told apart.
        MissingExtra: Matplotlib is not installed.
    """
    trace = trace_of(judged(solution))
    one = pass_of(trace, number)
    values = [one.values(d) for d in range(len(trace.joint_names))]
    counts = [len(each) for each in values]
    leaves = int(np.prod(counts))
    if leaves > MOST_LEAVES:
        raise InvalidUse(
            f"{one.name!r} has {leaves:,} leaves ({' x '.join(map(str, counts))}), at most {MOST_LEAVES:,} can be told "
            "apart; choose an arm of fewer joints, or fewer divisions"
        )
    errors = _errors(solution, np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(leaves, -1))
    best = int(np.argmin(errors))
    figure, axes = plane(size=size)
    axes.grid(False)
    above = np.array([(leaves - 1) / 2])
    width = 0.8 if leaves <= 100 else 0.3
    for d, count in enumerate(counts):
        below = leaves // int(np.prod(counts[: d + 1]))
        here = np.arange(leaves // below) * below + (below - 1) / 2
        for i, x in enumerate(here):
            best_way = best // below == i
            look = {"color": COLOURS[1], "linewidth": 2.2, "zorder": 2} if best_way else {"color": "#999999"}
            axes.plot([above[i // count], x], [-d, -d - 1], **({"linewidth": width, "zorder": 1} | look))
        if d + 1 < len(counts):
            axes.scatter(here, np.full(len(here), -d - 1), s=16, color="#444444", zorder=3)
        above = here
    axes.scatter([(leaves - 1) / 2], [0], s=24, color="black", zorder=3)
    dots = axes.scatter(
        above,
        np.full(leaves, -len(counts)),
        c=np.log10(np.maximum(errors, LEAST_ERROR)),
        s=26,
        cmap="viridis",
        zorder=3,
        edgecolors="none",
    )
    axes.scatter(
        above[best], -len(counts), s=90, facecolors="none", edgecolors=COLOURS[1], linewidths=1.6, zorder=4
    )
    figure.colorbar(dots, ax=axes, label="log10 of the weighted error", pad=0.01)
    units = ["" if kind == "number" else " m" if kind == "prismatic" else " rad" for kind in trace.kinds]
    ways = np.unravel_index(best, counts)
    names = [
        f"{name}\n{count} values\nbest {each[way]:.3g}{unit}"
        for name, count, each, way, unit in zip(trace.joint_names, counts, values, ways, units, strict=True)
    ]
    axes.set_yticks(-np.arange(len(counts) + 1), ["", *names])
    axes.set_xticks([])
    axes.tick_params(length=0)
    axes.set_title(f"{trace.search}, {one.name}: {leaves:,} leaves", fontsize=9)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.margins(x=0.04, y=0.1)
    return figure, axes


def circles(
    solution: Solution | Trace, joint: int | str = 0, passes: int = 3, size: float = 2.5
) -> tuple[Any, Any]:
    """Draw the values that the first passes try for a joint that turns as spokes of a circle, as Fig. 2 of the paper.

    Args:
        solution: Of one target with its trace, or the trace.
        joint: Its number from 0 on, or its name.
        passes: How many, of those that try more than one value of it.
        size: Of each circle [inch].

    Raises:
        InvalidUse: No trace, a batch, no such joint, one that slides, no pass with a window, or less than one pass.
        MissingExtra: Matplotlib is not installed.
    """
    trace = trace_of(solution)
    d = turning(trace, joint)
    if passes < 1:
        raise InvalidUse(f"passes must be at least 1, got {passes}")
    moved = [each for each in with_windows(trace) if len(each.values(d)) > 1]
    if not moved:
        raise InvalidUse(
            f"no pass of this {trace.search} tries more than one value of joint {trace.joint_names[d]!r}"
        )
    shown = {each.name: each for each in moved[:passes]}
    return _spokes(
        shown, d, f"{trace.joint_names[d]}: values tried, and the best known after the pass (dot)", size
    )


def breadths(
    traces: Mapping[str, Trace | Solution] | Sequence[Trace | Solution],
    joint: int | str = 0,
    number: int = 2,
    size: float = 2.5,
) -> tuple[Any, Any]:
    """Draw what one pass of several searches tries for a joint that turns, as Fig. 3 of the paper does for three breadths.

    Args:
        traces: As in `progress`, of searches for the same target.
        joint: Its number from 0 on, or its name.
        number: Of the pass, from 1 on.
        size: Of each circle [inch].

    Raises:
        InvalidUse: As `circles`, or a search that has no such pass.
        MissingExtra: Matplotlib is not installed.
    """
    drawn = named(traces)
    shown = {name: pass_of(trace, number) for name, trace in drawn.items()}
    trace = next(iter(drawn.values()))
    d = turning(trace, joint)
    return _spokes(
        shown,
        d,
        f"{trace.joint_names[d]}, pass {number}: values tried, and the best known after it (dot)",
        size,
    )


def _spokes(shown: Mapping[str, Pass], d: int, caption: str, size: float) -> tuple[Any, Any]:
    """A circle for each pass, its values of joint d as spokes."""
    figure, axes = plane(len(shown), size=(size * len(shown), size + 0.9))
    around = np.linspace(0, 2 * np.pi, 200)
    for i, (each, (name, pass_)) in enumerate(zip(np.ravel(axes), shown.items(), strict=True)):
        each.plot(np.cos(around), np.sin(around), color="black", linewidth=1.6)
        for value in pass_.values(d):
            each.plot([0, np.cos(value)], [0, np.sin(value)], color=COLOURS[1], linewidth=1.1)
        best = pass_.q[d]
        each.plot(np.cos(best), np.sin(best), MARKS[0], color=COLOURS[0], markersize=7, zorder=3)
        count = len(pass_.values(d))
        tried = "1 value"
        if count > 1 and pass_.spacing is not None:
            tried = f"{count} values, {np.rad2deg(pass_.spacing[d]):.3g}° apart"
        each.set_title(f"({chr(97 + i)}) {name}\n{tried}", fontsize=9)
        each.set(xlim=(-1.12, 1.12), ylim=(-1.12, 1.12))
        each.set_aspect("equal")
        each.axis("off")
    figure.supxlabel(caption, fontsize=9)
    return figure, axes


def windows(
    solution: Solution,
    joints: tuple[int | str, int | str] = (0, 1),
    size: tuple[float, float] = (8.6, 4.2),
) -> tuple[Any, Any]:
    """Draw the windows of the passes closing in on the answer, over the landscape of the weighted error.

    On the left the whole ranges of two joints, on the right what is around the answer, a cross; all other joints stand where
    the answer has them. A frame is a window, a dot the best known after its pass, and darker is nearer to the goal.
    Windows too small to see are left out.

    Args:
        solution: Of one target, with its trace.
        joints: Which two, by number from 0 on or by name.
        size: Of the figure [inch].

    Raises:
        InvalidUse: No trace, a batch, not two joints of the arm, or no pass with a window.
        MissingExtra: Matplotlib is not installed.
    """
    trace = trace_of(judged(solution))
    if not isinstance(joints, Sequence) or isinstance(joints, str) or len(joints) != 2:
        raise InvalidUse(f"joints must be two, by number or by name; got {joints!r}")
    x, y = (joint_of(trace, joint) for joint in joints)
    if x == y:
        raise InvalidUse(f"joints must be two different ones, got {joints!r}")
    shown = with_windows(trace)
    lower, upper = solution.problem.limits
    figure, axes = plane(2, size=size)
    answer = np.asarray(solution.q)
    centre, half = answer[[x, y]], (upper - lower)[[x, y]] / 2
    # The right panel shows the fourth window, or the last: about a ninth of the second.
    near = shown[min(3, len(shown) - 1)]
    close = np.maximum(np.subtract(*near.ends[::-1])[[x, y]] * 1.5, 1e-9)
    boxes = [
        (np.array([lower[x], lower[y]]), np.array([upper[x], upper[y]])),
        (centre - np.minimum(close, half), centre + np.minimum(close, half)),
    ]
    for each, (low, high) in zip(axes, boxes, strict=True):
        image = _landscape(each, solution, (x, y), low, high)
        for i, pass_ in enumerate(shown):
            start, end = (each_end[[x, y]] for each_end in pass_.ends)
            wide = end - start
            if (wide < (high - low) / 60).any() or i == 6:  # As many colours as can be told apart on grey.
                break
            colour = COLOURS[i % 6]
            for turn in _turns(solution, (x, y)):
                corner = start + turn
                each.add_patch(pyplot().Rectangle(corner, *wide, fill=False, edgecolor=colour, linewidth=1.6))
            each.plot(
                *pass_.q[[x, y]],
                MARKS[0],
                color=colour,
                markeredgecolor="black",
                markersize=6,
                zorder=4,
                label=pass_.name,
            )
        each.plot(*centre, "x", color="white", markeredgewidth=4, markersize=9, zorder=5)
        each.plot(*centre, "x", color="black", markeredgewidth=1.8, markersize=8, zorder=6)
        each.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        each.set(xlabel=_axis(trace, x), ylabel=_axis(trace, y))
        each.grid(False)
        figure.colorbar(image, ax=each, label="log10 of the weighted error", pad=0.01)
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
    return figure, axes


def _landscape(axes: Any, solution: Solution, joints: tuple[int, int], low: Array, high: Array) -> Any:
    """Colour a part of the plane of two joints by the weighted error there."""
    first, second = (np.linspace(low[i], high[i], FINE) for i in range(2))
    q = np.repeat(np.asarray(solution.q)[None], FINE * FINE, axis=0)
    q[:, joints[0]], q[:, joints[1]] = np.tile(first, FINE), np.repeat(second, FINE)
    errors = np.log10(np.maximum(_errors(solution, q), LEAST_ERROR)).reshape(FINE, FINE)
    return axes.pcolormesh(first, second, errors, cmap=_greys(), shading="nearest", rasterized=True)


def _greys() -> Any:
    """Dark to light, and never so dark or light that a coloured line is lost on it."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("greys", ["0.3", "0.97"])


def _errors(solution: Solution, q: Array) -> Array:
    """Weighted errors at joint values, (k, n) -> (k,)."""
    problem = solution.problem
    target = np.broadcast_to(problem.goal.target, (len(q), 4, 4))
    many = replace(problem, goal=problem.goal.at(target), near=None, trace=False)
    return np.asarray(judge(many, q)[:, 2])


def _turns(solution: Solution, joints: tuple[int, int]) -> list[Array]:
    """By what a window is moved to be seen at both ends of the range of a joint that turns fully."""
    wraps, lower, upper = solution.problem.mechanism.wraps, *solution.problem.limits
    ways = [(-1, 0, 1) if wraps[joint] else (0,) for joint in joints]
    full = [upper[joint] - lower[joint] for joint in joints]
    return [np.array([i * full[0], k * full[1]]) for i in ways[0] for k in ways[1]]


def _axis(trace: Trace, joint: int) -> str:
    """What an axis of a joint's values is called."""
    unit = {"prismatic": " [m]", "number": ""}.get(trace.kinds[joint], " [rad]")
    return f"{trace.joint_names[joint]}{unit}"
