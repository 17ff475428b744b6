"""What Figures 8 and 9 share: the paper's heuristics on the paper's arms, the same points for all."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from .arms import ARMS, METHODS
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, column, finish, mean_bars, where


def cases(effort: Effort) -> list[Row]:
    """Every method on every arm."""
    del effort
    return [{"dof": dof, "arm": arm, "method": method} for dof, arm in ARMS.items() for method in METHODS]


def draw(rows: Sequence[Row], path: Path, quantities: dict[str, str], title: str) -> None:
    """One panel a quantity, one line a method, DOF across."""
    figure, axes = canvas(1, len(quantities), (5.4 * len(quantities), 4.8))
    for axis, (quantity, label) in zip(axes[0], quantities.items(), strict=True):
        for number, (look, method) in enumerate(zip(LOOKS, METHODS, strict=False)):
            some = where(rows, method=method)
            # Side by side, so that methods with equal answers do not cover each other.
            places = [list(ARMS).index(int(dof)) + 0.07 * (number - 2.5) for dof in column(some, "dof")]
            axis.plot(places, column(some, quantity), label=method, **look)
            if quantity == "position_mean_mm":
                mean_bars(axis, places, some, look)
                axis.set_ylim(bottom=0.05)
        axis.set(yscale="log", ylabel=label, xticks=range(len(ARMS)))
        axis.set_xticklabels([NAMES[dof].replace(" (", "\n(") for dof in ARMS])
    finish(figure, axes[0, 0], path, title, len(METHODS), title="DaC +")
