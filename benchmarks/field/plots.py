"""Plots of the page, as SVG that stands in it."""

from __future__ import annotations

import io
import logging
from typing import Any

import numpy as np
import pandas as pd


def _svg(figure: Any) -> str:
    import matplotlib.pyplot as plt

    logging.getLogger("matplotlib.font_manager").setLevel(
        logging.ERROR
    )  # else it tells of fonts for formulas
    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    drawn = text.getvalue()
    return drawn[drawn.index("<svg") :]


def colours(solvers: list[str]) -> dict[str, Any]:
    """One colour a solver, the same in all plots: the strong ones of twenty first."""
    from matplotlib import colormaps

    order = [*range(0, 20, 2), *range(1, 20, 2)]
    return {solver: colormaps["tab20"](order[i % 20]) for i, solver in enumerate(sorted(solvers))}


def exact_against_time(random: pd.DataFrame, names: dict[str, str]) -> str:
    """Summed random poses: each solver with its recommended settings (ring) and its best (dot)."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 5.5))
    shades = colours(list(random["solver"].unique()))
    dots = {}
    for solver, group in random.groupby("solver"):
        rows = group.set_index("settings")
        shade = shades[str(solver)]
        if len(rows) > 1:
            axes.plot(rows["median"], rows["exact"], color=shade, linewidth=1, alpha=0.6)
        for settings, row in rows.iterrows():
            filled = settings != "recommended" or len(rows) == 1
            axes.errorbar(
                *(row["median"], row["exact"]),
                yerr=[
                    [max(row["exact"] - row["exact_low"], 0.0)],
                    [max(row["exact_high"] - row["exact"], 0.0)],
                ],
                **{"fmt": "o", "color": shade, "capsize": 2, "markersize": 8},
                markerfacecolor=shade if filled else "white",
            )
            if filled:
                dots[str(solver)] = row["median"], row["exact"]
    axes.set(
        xscale="log",
        xlabel="median time of a call [µs]",
        ylabel="exact [%]",
        ylim=(-3, 145),
        yticks=range(0, 101, 20),
    )
    low, high = np.log10(axes.get_xlim())
    ranked = sorted(dots, key=lambda solver: dots[solver][0])
    wanted = np.log10([dots[solver][0] for solver in ranked])
    for solver, place in zip(ranked, _aside(wanted, (high - low) / 30), strict=True):
        axes.annotate(
            names[solver],
            dots[solver],
            (10**place, 113),
            rotation=55,
            fontsize=9,
            color="#1c2126",
            arrowprops={"arrowstyle": "-", "color": shades[solver], "linewidth": 0.8, "shrinkB": 4},
        )
    axes.grid(alpha=0.3)
    return _svg(figure)


def _aside(places: Any, apart: float) -> Any:
    """Places, ascending, moved as little as it takes to be so far apart."""
    moved = np.array(places, dtype=float)
    for _ in range(200):
        gaps = np.diff(moved)
        close = np.maximum(apart - gaps, 0.0) / 2
        if close.max(initial=0.0) < 1e-3 * apart:
            break
        moved[:-1] -= close
        moved[1:] += close
    return moved


def times(answers: pd.DataFrame, names: dict[str, str]) -> str:
    """What share of calls takes longer than a time: the tails."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 5))
    shades = colours(list(answers["solver"].unique()))
    for solver in answers.groupby("solver")["microseconds"].median().sort_values().index:
        ranked = np.sort(answers.loc[answers["solver"] == solver, "microseconds"].dropna().to_numpy())
        longer = 1.0 - np.arange(len(ranked)) / max(len(ranked), 1)
        axes.step(ranked, longer, color=shades[solver], linewidth=1.8, label=names[solver])
    axes.set(
        xscale="log", yscale="log", xlabel="time of a call [µs]", ylabel="share of calls that take longer"
    )
    axes.grid(alpha=0.3)
    axes.legend(fontsize=9, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, title="by median")
    return _svg(figure)
