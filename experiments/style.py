"""One look for every picture: colours, dashes and markers that stay apart in grey."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from .effort import Row

LOOKS: tuple[dict[str, Any], ...] = (
    {"color": "#000000", "marker": "o", "linestyle": "-"},
    {"color": "#c23b00", "marker": "s", "linestyle": "--"},
    {"color": "#0072b2", "marker": "^", "linestyle": "-."},
    {"color": "#e69f00", "marker": "D", "linestyle": ":"},
    {"color": "#56b4e9", "marker": "v", "linestyle": (0, (5, 1))},
    {"color": "#7a4e8f", "marker": "P", "linestyle": (0, (1, 1))},
    {"color": "#009e73", "marker": "X", "linestyle": (0, (3, 1, 1, 1))},
    {"color": "#999999", "marker": "*", "linestyle": "-"},
)
DOTS: tuple[dict[str, Any], ...] = tuple({**look, "linestyle": "none"} for look in LOOKS)
"""The same without lines."""
NAMES = {2: "2 DOF (planar)", 3: "3 DOF (cylindrical)", 4: "4 DOF (SCARA)", 6: "6 DOF (elbow)"}


def canvas(rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.4, 4.4), **options: Any) -> Any:
    """A figure and its axes, drawn without a screen."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    # A wide picture is shown as narrow as the page, so its letters are larger.
    letters = 9 * max(1.0, size[0] / 11)
    pyplot.rcParams.update(
        {"font.size": letters, "axes.grid": True, "grid.alpha": 0.3, "lines.markersize": 5}
    )
    return pyplot.subplots(rows, columns, figsize=size, layout="constrained", squeeze=False, **options)


def save(figure: Any, path: Path) -> None:
    """Write the PNG and forget the figure."""
    from matplotlib import pyplot

    figure.savefig(path, dpi=130, metadata={"Software": None})
    pyplot.close(figure)


def where(rows: Sequence[Row], **wanted: Any) -> list[Row]:
    """The rows whose columns have the wanted values."""
    return [row for row in rows if all(row[key] == value for key, value in wanted.items())]


def column(rows: Sequence[Row], name: str) -> list[Any]:
    """One column."""
    return [row[name] for row in rows]


def lines(
    axis: Any,
    rows: Sequence[Row],
    x: str,
    y: str,
    key: str,
    values: Iterable[Any],
    label: str | Mapping[Any, str] = "{}",
    looks: Sequence[dict[str, Any]] = LOOKS,
) -> None:
    """A line for each value of a column.

    Args:
        axis: Where.
        rows: Of the CSV.
        x: Column across.
        y: Column upwards.
        key: Column whose values have a line each.
        values: In the order of the looks.
        label: Of each value, or one with {} for it.
        looks: Of the lines.
    """
    for look, value in zip(looks, values, strict=False):
        some = where(rows, **{key: value})
        told = label.format(value) if isinstance(label, str) else label[value]
        axis.plot(column(some, x), column(some, y), label=told, **look)


def finish(figure: Any, axis: Any, path: Path, heading: str, ncols: int = 6, **legend: Any) -> None:
    """Put the legend of one panel below the figure and a title above it, and write it."""
    handles = axis.get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=ncols, **legend)
    figure.suptitle(heading)
    save(figure, path)


def plain_ticks(axis: Any, values: Sequence[float]) -> None:
    """Label a logarithmic axis at given values, in plain numbers."""
    from matplotlib.ticker import FixedLocator, NullLocator, StrMethodFormatter

    axis.set_major_locator(FixedLocator(list(values)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(StrMethodFormatter("{x:g}"))


def mean_bars(axis: Any, places: Sequence[float], rows: Sequence[Row], look: dict[str, Any]) -> None:
    """The 95 % confidence interval of every mean, as a thin bar: 1.96 standard errors to either side."""
    for place, row in zip(places, rows, strict=True):
        mean, spread = row["position_mean_mm"], 1.96 * row["position_standard_error_mm"]
        # On a logarithmic axis an interval that contains zero runs to the lower edge.
        low = max(mean - spread, 1e-6)
        axis.plot([place, place], [low, mean + spread], color=look["color"], linewidth=1, alpha=0.7, zorder=1)
