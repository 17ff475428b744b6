"""kinseek: its manual recommends no settings but the defaults, `arm.ik(T)` (docs/quickstart.md)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from benchmarks.field.protocol import Answer, Arm, Array

NAME = "kinseek"
PACKAGE = "kinseek"
RECOMMENDED: dict[str, Any] = {}
SWEEP: tuple[dict[str, Any], ...] = ()


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        import kinseek

        self._arm = kinseek.load(arm.urdf, base=arm.base, tip=arm.tip)
        self._place, self._settings = kinseek.Goal.position, settings

    def solve(self, T: Any, start: Any) -> Answer:
        given = self._settings if start is None else {**self._settings, "near": start}
        solution = self._arm.ik(T, **given)
        return Answer(solution.q, bool(solution.success))

    def position(self, place: Array, start: Array | None) -> Answer:
        solution = self._arm.ik(self._place(place))
        return Answer(solution.q, bool(solution.success))

    def branches(self, T: Array) -> Sequence[Array]:
        return list(self._arm.branches(T).q)

    def batch(self, poses: Array) -> tuple[Array, Sequence[bool]]:
        solution = self._arm.ik(poses, threads=1)
        return solution.q, [bool(each) for each in solution.success]


load = _Solver
