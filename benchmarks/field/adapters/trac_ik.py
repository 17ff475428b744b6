"""TRAC-IK through pytracik: KDL with restarts beside an SQP solver, whichever is first.

https://github.com/chenhaox/pytracik: `TracIK(base, tip, urdf)` with its defaults. A start is needed; without one the
middle of the ranges. In the sweep more time and smaller errors.
"""

from __future__ import annotations

from typing import Any

from benchmarks.field.protocol import Answer, Arm, Refused

NAME = "TRAC-IK"
PACKAGE = "pytracik"
RECOMMENDED: dict[str, Any] = {"timeout": 0.005, "epsilon": 1e-5, "solver_type": "Speed"}
SWEEP: tuple[dict[str, Any], ...] = (
    {"timeout": 0.005, "epsilon": 5e-7, "solver_type": "Speed"},
    {"timeout": 0.02, "epsilon": 5e-7, "solver_type": "Speed"},
    {"timeout": 0.05, "epsilon": 5e-7, "solver_type": "Speed"},
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        import trac_ik

        self._solver = trac_ik.TracIK(arm.base, arm.tip, arm.urdf, **settings)
        if self._solver.dof != len(arm.joints):
            raise Refused(f"reads {self._solver.dof} joints of {len(arm.joints)}")
        self._middle = arm.middle

    def solve(self, T: Any, start: Any) -> Answer:
        q = self._solver.ik(T[:3, 3], T[:3, :3], self._middle if start is None else start)
        return Answer(q, q is not None)


load = _Solver
