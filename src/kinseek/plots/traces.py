"""Pictures of searches from their traces: Figures 1 to 3 of the paper, and comparisons of searches."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse
from kinseek.solution import Solution
from kinseek.support.validation import as_integer
from kinseek.trace import Pass, Trace

from .figures import COLOURS, drawn, given_or_new, plane, text_of
from .landscapes import LEAST_ERROR, MARKS, errors_at
from .shown import judged, named, pass_of, trace_of, turning, with_windows

Array = NDArray[np.float64]

MOST_LEAVES = 1000
"""Maximum number of leaves of a tree that is drawn."""


@drawn
def progress(
    traces: Mapping[str, Trace | Solution] | Sequence[Trace | Solution],
    error: str = "weighted",
    *,
    ax: Any = None,
    size: tuple[float, float] = (6.4, 4.2),
) -> Any:
    """Draw the error of the best known joint values against the number of FK evaluations, for one or several searches.

    A mark is the end of a pass; if there are many passes, only some are marked. Zero evaluations are drawn as one.

    Args:
        traces: Traces of single targets, or solutions with traces: by name, or in a sequence, with the names of their
            searches.
        error: ``"weighted"``, ``"position"`` [m] or ``"orientation"`` [rad].
        ax: Axes in a plane to draw on.
        size: Size of a new figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: No traces, a batch, an unknown error, or other axes.
        MissingExtra: Matplotlib is not installed.
    """
    names = {
        "weighted": "weighted error",
        "position": "position error [m]",
        "orientation": "angle error [rad]",
    }
    if error not in names:
        raise InvalidUse(f"error must be one of {', '.join(names)}; got {error!r}")
    shown = named(traces)
    figure, axes = given_or_new(ax, size)
    for i, (name, trace) in enumerate(shown.items()):
        errors = np.maximum(getattr(trace, f"{error}_errors"), LEAST_ERROR)
        spent, look = np.maximum(trace.evaluations, 1), {"color": COLOURS[i % len(COLOURS)]}
        axes.plot(spent, errors, drawstyle="steps-post", linewidth=1.4, **look)
        every = max(1, len(spent) // 12)
        marked = np.unique([*range(0, len(spent), every), len(spent) - 1]) if len(spent) else np.arange(0)
        axes.plot(spent[marked], errors[marked], MARKS[i % len(MARKS)], markersize=5, label=name, **look)
    axes.set(xscale="log", yscale="log", xlabel="FK evaluations", ylabel=f"{names[error]} of the best known")
    if ax is None:
        figure.legend(loc="outside upper center", ncols=min(3, len(shown)), frameon=False)
    else:
        axes.legend()
    return figure


@drawn
def tree(solution: Solution, number: int = 1, size: tuple[float, float] = (7.2, 3.6)) -> Any:
    """Draw the search tree of one pass over a grid, as Fig. 1 of the paper: a level for each joint, a leaf for each node.

    The leaves are coloured by their weighted error, and the path to the best leaf is bold.

    Args:
        solution: Solution of one target, with its trace.
        number: Number of the pass, from 1.
        size: Size of the figure [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: No trace, a batch, a pass without a window, or too many leaves to distinguish.
        MissingExtra: Matplotlib is not installed.
    """
    trace = trace_of(judged(solution))
    one = pass_of(trace, number)
    values = [one.values(d) for d in range(len(trace.joint_names))]
    counts = [len(each) for each in values]
    leaves = int(np.prod(counts))
    if leaves > MOST_LEAVES:
        raise InvalidUse(
            f"{one.name!r} has {leaves:,} leaves ({' x '.join(map(str, counts))}), at most {MOST_LEAVES:,} can be "
            "distinguished; choose an arm of fewer joints, or fewer divisions"
        )
    errors = errors_at(solution, np.stack(np.meshgrid(*values, indexing="ij"), axis=-1).reshape(leaves, -1))
    best = int(np.argmin(errors))
    figure, axes = plane(size=size)
    axes.grid(False)
    above = np.array([(leaves - 1) / 2])
    width = 0.8 if leaves <= 100 else 0.3
    for d, count in enumerate(counts):
        below = leaves // int(np.prod(counts[: d + 1]))
        here = np.arange(leaves // below) * below + (below - 1) / 2
        for i, x in enumerate(here):
            on_best_path = best // below == i
            look = (
                {"color": COLOURS[1], "linewidth": 2.2, "zorder": 2} if on_best_path else {"color": "#999999"}
            )
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
        f"{text_of(name)}\n{count} values\nbest {each[way]:.3g}{unit}"
        for name, count, each, way, unit in zip(trace.joint_names, counts, values, ways, units, strict=True)
    ]
    axes.set_yticks(-np.arange(len(counts) + 1), ["", *names])
    axes.set_xticks([])
    axes.tick_params(length=0)
    axes.set_title(f"{trace.search}, {one.name}: {leaves:,} leaves", fontsize=9)
    for side in axes.spines.values():
        side.set_visible(False)
    axes.margins(x=0.04, y=0.1)
    return figure


@drawn
def circles(solution: Solution | Trace, joint: int | str = 0, passes: int = 3, size: float = 2.5) -> Any:
    """Draw the values that the first passes try for a revolute joint as spokes of a circle, as Fig. 2 of the paper.

    Args:
        solution: Solution of one target with its trace, or the trace.
        joint: Index of the joint from 0, or its name.
        passes: Number of passes, of those that try more than one value of the joint.
        size: Size of each circle [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: No trace, a batch, no such joint, a prismatic joint, no pass with a window, or less than one pass.
        MissingExtra: Matplotlib is not installed.
    """
    trace = trace_of(solution)
    d = turning(trace, joint)
    passes = as_integer("passes", passes, 1, error=InvalidUse)
    moved = [each for each in with_windows(trace) if len(each.values(d)) > 1]
    if not moved:
        raise InvalidUse(
            f"no pass of this {trace.search} tries more than one value of joint {trace.joint_names[d]!r}"
        )
    shown = {each.name: each for each in moved[:passes]}
    return _spokes(
        shown,
        d,
        f"{text_of(trace.joint_names[d])}: values tried, and the best known after the pass (dot)",
        size,
    )


@drawn
def breadths(
    traces: Mapping[str, Trace | Solution] | Sequence[Trace | Solution],
    joint: int | str = 0,
    number: int = 2,
    size: float = 2.5,
) -> Any:
    """Draw the values that one pass of several searches tries for a revolute joint, as Fig. 3 of the paper.

    That figure shows three breadths.

    Args:
        traces: As in `progress`, of searches for the same target.
        joint: Index of the joint from 0, or its name.
        number: Number of the pass, from 1.
        size: Size of each circle [inch].

    Returns:
        The Matplotlib figure.

    Raises:
        InvalidUse: As `circles`, or a search that has no such pass.
        MissingExtra: Matplotlib is not installed.
    """
    searches = named(traces)
    shown = {name: pass_of(trace, number) for name, trace in searches.items()}
    trace = next(iter(searches.values()))
    d = turning(trace, joint)
    return _spokes(
        shown,
        d,
        f"{text_of(trace.joint_names[d])}, pass {number}: values tried, and the best known after it (dot)",
        size,
    )


def _spokes(shown: Mapping[str, Pass], d: int, caption: str, size: float) -> Any:
    """Draw a circle for each pass, with its values of joint d as spokes."""
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
    return figure
