"""Other link lengths: do the comparisons of Figure 8 depend on the lengths that the paper does not print?"""

from __future__ import annotations

import importlib.resources
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import kinseek

from .arms import ARMS, BRANCHING_FACTOR, BY_HAND, DIVISIONS, errors, random_goals
from .effort import Effort, Row
from .style import LOOKS, NAMES, canvas, column, finish, where

REACH = 0.75
"""Both links together, as in the catalogue [m]."""
METHODS = ("CB(1)", "CB(2)", "CB(3)", "BT")


def cases(effort: Effort) -> list[Row]:
    """The forearm's share of the reach, a third in the catalogue; and a hand that reaches beyond the wrist."""
    asked = [(dof, share, 0.0) for dof in (2, 4, 6) for share in effort.pick((0.15, 1 / 3, 0.5, 0.7), (0.5,))]
    asked += effort.pick([(6, 1 / 3, 0.05), (6, 1 / 3, 0.15)], [])
    return [
        {"dof": dof, "arm": ARMS[dof], "fore_share": round(share, 3), "tool_m": tool, "method": method}
        for dof, share, tool in asked
        for method in METHODS
    ]


def arm_with(name: str, share: float, tool: float) -> kinseek.Arm:
    """An arm of the catalogue with other lengths: its file, with the two links and the tip moved."""
    text = (importlib.resources.files("kinseek") / "robots" / "catalog" / f"{name}.urdf").read_text()
    fore = REACH * share
    tip = '<joint name="tip_mount" type="fixed">\n    <parent link="flange"/>\n    <child link="tip"/>\n    <origin xyz="'
    text = text.replace('xyz="0.25 0 0"', 'xyz="FORE 0 0"').replace(
        'xyz="0.5 0 0"', f'xyz="{REACH - fore} 0 0"'
    )
    text = text.replace("FORE", str(fore)).replace(tip + "0 0 0", tip + f"{tool} 0 0")
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.urdf"
        path.write_text(text)
        return kinseek.load(str(path))


def measure(case: Row, effort: Effort) -> Row:
    """Errors of a batch."""
    arm = arm_with(case["arm"], case["fore_share"], case["tool_m"])
    points, method = effort.pick(300, 3), case["method"]
    breadth = BY_HAND[arm.dof] if method == "BT" else int(method[3])
    solver = kinseek.DivideAndConquer(BRANCHING_FACTOR, DIVISIONS, breadth)
    solution = arm.ik(random_goals(arm, points, effort.seed), solver=solver)
    return {**errors(solution)}


def draw(rows: Sequence[Row], path: Path) -> None:
    """Mean error against the forearm's share; and against the hand's length."""
    figure, axes = canvas(1, 4, (13, 4.2), sharey=True)
    for axis, dof in zip(axes[0], (2, 4, 6), strict=False):
        for look, method in zip(LOOKS, METHODS, strict=False):
            some = where(rows, dof=dof, method=method, tool_m=0.0)
            _line(axis, some, "fore_share", method, look)
        axis.set(yscale="log", title=NAMES[dof], xlabel="forearm's share of the reach")
    for look, method in zip(LOOKS, METHODS, strict=False):
        some = [row for row in where(rows, dof=6, method=method) if abs(row["fore_share"] - 1 / 3) < 0.01]
        _line(axes[0, 3], sorted(some, key=lambda row: row["tool_m"]), "tool_m", method, look)
    axes[0, 3].set(title=NAMES[6], xlabel="hand beyond the wrist's centre [m]")
    axes[0, 0].set_ylabel("mean position error [mm]")
    finish(
        figure,
        axes[0, 0],
        path,
        "Other link lengths, the same reach: D = 3, B = 7200, with 95 % intervals",
        6,
    )


def _line(axis: Any, rows: Sequence[Row], name: str, label: str, look: dict[str, Any]) -> None:
    spread = [1.96 * row["position_standard_error_mm"] for row in rows]
    axis.errorbar(
        column(rows, name), column(rows, "position_mean_mm"), spread, label=label, capsize=3, **look
    )
