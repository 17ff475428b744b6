"""Plots of the page, as SVG that stands in it."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
import pandas as pd


def _svg(figure: Any) -> str:
    import matplotlib.pyplot as plt

    text = io.StringIO()
    figure.savefig(text, format="svg", bbox_inches="tight", metadata={"Date": None})
    plt.close(figure)
    drawn = text.getvalue()
    return drawn[drawn.index("<svg") :]


def colours(solvers: list[str]) -> dict[str, Any]:
    """One colour a solver, the same in all plots."""
    from matplotlib import colormaps

    return {solver: colormaps["tab20"](i % 20) for i, solver in enumerate(sorted(solvers))}


def exact_against_time(random: pd.DataFrame, names: dict[str, str]) -> str:
    """Summed random poses: each solver with its recommended settings (ring) and its best (dot)."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 5))
    shades = colours(list(random["solver"].unique()))
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
                place: dict[str, Any] = {"textcoords": "offset points", "rotation": 40, "fontsize": 9}
                axes.annotate(names[str(solver)], (row["median"], row["exact"]), (2, 7), **place)
    axes.set(
        xscale="log",
        xlabel="median time of a call [µs]",
        ylabel="exact [%]",
        ylim=(-3, 122),
        yticks=range(0, 101, 20),
    )
    axes.grid(alpha=0.3)
    return _svg(figure)


def times(answers: pd.DataFrame, names: dict[str, str]) -> str:
    """What share of calls takes longer than a time: the tails."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(9, 5))
    shades = colours(list(answers["solver"].unique()))
    for key, rows in answers.groupby(["solver", "settings"]):
        solver, settings = map(str, key)
        ranked = np.sort(rows["microseconds"].dropna().to_numpy())
        longer = 1.0 - np.arange(len(ranked)) / max(len(ranked), 1)
        axes.step(
            *(ranked, longer),
            color=shades[solver],
            linestyle="--" if settings == "recommended" else "-",
            label=f"{names[solver]} ({settings})",
        )
    axes.set(
        xscale="log", yscale="log", xlabel="time of a call [µs]", ylabel="share of calls that take longer"
    )
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.01, 0.5), frameon=False)
    return _svg(figure)
