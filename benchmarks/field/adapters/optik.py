"""OptIK: an SQP solver in Rust with random restarts, on one thread.

https://github.com/kylc/optik: `robot.ik(SolverConfig(), T, x0)` with the defaults; the start is needed, without one
the middle of the ranges. In the sweep smaller residuals.
"""

from __future__ import annotations

from typing import Any

from benchmarks.field.protocol import Answer, Arm, Refused

NAME = "OptIK"
PACKAGE = "optik-py"
RECOMMENDED: dict[str, Any] = {"solution_mode": "speed", "max_time": 0.1, "tol_f": 1e-6}
SWEEP: tuple[dict[str, Any], ...] = tuple(
    {"solution_mode": "speed", "max_time": 0.1, "tol_f": tolerance} for tolerance in (1e-10, 1e-12, 2.5e-13)
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        import optik

        self._robot = optik.Robot.from_urdf_file(arm.urdf, arm.base, arm.tip)
        self._robot.set_parallelism(1)
        if self._robot.num_positions() != len(arm.joints):
            raise Refused(f"reads {self._robot.num_positions()} joints of {len(arm.joints)}")
        self._config = optik.SolverConfig(**settings)
        self._middle = arm.middle

    def solve(self, T: Any, start: Any) -> Answer:
        found = self._robot.ik(self._config, T, self._middle if start is None else start)
        return Answer(None, False) if found is None else Answer(found[0], True)


load = _Solver
