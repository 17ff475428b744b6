"""Plots of the page, as SVG that stands in it."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pandas as pd


def _panel(solvers: Any) -> tuple[Any, Any, dict[str, Any]]:
    """A figure, its axes, and a colour for each solver: the strong ones of twenty first."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(10, 5))
    order = [*range(0, 20, 2), *range(1, 20, 2)]
    shades = [plt.colormaps["tab20"](order[i % 20]) for i in range(len(solvers))]
    return figure, axes, dict(zip(sorted(solvers), shades, strict=True))


def _svg(figure: Any, axes: Any) -> str:
    import matplotlib.pyplot as plt

    axes.grid(alpha=0.3)
    axes.legend(fontsize=9, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False, title="by median")
    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    drawn = text.getvalue()
    return drawn[drawn.index("<svg") :]


def exact_against_time(random: pd.DataFrame, names: dict[str, str]) -> str:
    """Summed random poses: each solver with its recommended settings (ring) and its best (dot)."""
    figure, axes, shades = _panel(random["solver"].unique())
    random = random.sort_values(["median", "settings"])
    for solver, rows in random.groupby("solver", sort=False):
        shade = shades[str(solver)]
        axes.plot(rows["median"], rows["exact"], color=shade, linewidth=1, alpha=0.6)
        for row in rows.to_dict("records"):
            filled = row["settings"] != "recommended" or len(rows) == 1
            spread = [[row["exact"] - row["exact_low"]], [row["exact_high"] - row["exact"]]]
            axes.errorbar(
                *(row["median"], row["exact"], np.maximum(spread, 0.0)),
                **{"fmt": "o", "color": shade, "capsize": 2, "markersize": 8},
                markerfacecolor=shade if filled else "white",
                label=names[str(solver)] if filled else None,
            )
    axes.set(xscale="log", xlabel="median time of a call [µs]", ylabel="exact [%]", ylim=(-3, 103))
    return _svg(figure, axes)


def times(answers: pd.DataFrame, names: dict[str, str]) -> str:
    """What share of calls takes longer than a time: the tails."""
    figure, axes, shades = _panel(answers["solver"].unique())
    for solver in answers.groupby("solver")["microseconds"].median().sort_values().index:
        ranked = np.sort(answers.loc[answers["solver"] == solver, "microseconds"].dropna().to_numpy())
        longer = 1.0 - np.arange(len(ranked)) / max(len(ranked), 1)
        axes.step(ranked, longer, color=shades[solver], linewidth=1.8, label=names[solver])
    label = "share of calls that take longer"
    axes.set(xscale="log", yscale="log", xlabel="time of a call [µs]", ylabel=label)
    return _svg(figure, axes)
