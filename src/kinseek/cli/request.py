"""The request of one command line to an arm, for one pose or many."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.branches.order import ORDERS, Preferred
from kinseek.branches.result import Branches, BranchesBatch
from kinseek.collision import Scene
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.proof.certificate import Certificate, Verdict
from kinseek.solution import Solution
from kinseek.solvers.base import Solver

from .goals import GoalSpec


@dataclass(frozen=True)
class SolveRequest:
    """An arm, the constrained part of a pose, and the selection of solutions."""

    arm: Arm
    goal_spec: GoalSpec
    deg: bool
    """Are angles of the poses in degrees?"""
    near: NDArray[np.float64] | None = None
    search: Solver | None = None
    prefer: str | Mapping[str, Any] | None = None
    prove: bool = False
    trace: bool = False
    scene: Scene | None = None
    clearance: float = 0.0
    """Minimum distance of bodies [m]."""
    every: bool = False
    """Is every solution requested?"""
    count: int | None = None
    """Maximum number of these per pose."""

    def solve(self, goal: Goal, progress: bool = False) -> Solution:
        """Solve one goal, or a batch."""
        return self.arm.ik(
            goal,
            near=self.near,
            solver=self.search,
            prefer=cast("Preferred | None", self.prefer),
            prove=self.prove,
            trace=self.trace,
            scene=self.scene,
            clearance=self.clearance,
            progress=progress,
        )

    def solve_with_proof(self, goal: Goal) -> tuple[Solution, Certificate | None]:
        """Solve one goal, and keep the certificate of `prove`; in a scene it proves more than one statement."""
        if self.scene is not None:
            return self.solve(goal), None
        from kinseek.proof.branch_and_bound import prove

        solution = replace(self, prove=False).solve(goal)
        proof = prove(solution.problem, solution=solution)
        return replace(solution, proved_unreachable=proof.verdict is Verdict.UNREACHABLE), proof

    def branches(self, goal: Goal) -> Branches | BranchesBatch:
        """Return every solution of one goal, or of each of a batch.

        Raises:
            InvalidProblem: A search or a trace is requested, too.
        """
        if self.search is not None or self.trace:
            raise InvalidProblem("--all has its own search; it cannot be combined with --solver or --trace")
        if isinstance(self.prefer, Mapping):
            raise InvalidProblem(
                "--prefer NAME=VALUE chooses one solution by its posture; it cannot be combined with --all, which prints "
                f"every one. Valid with --all: --prefer {', '.join(ORDERS[:-1])} or {ORDERS[-1]}"
            )
        order: dict[str, Any] = {} if self.prefer is None else {"order": self.prefer}
        return self.arm.branches(
            goal,
            near=self.near,
            count=self.count,
            prove=self.prove,
            scene=self.scene,
            clearance=self.clearance,
            **order,
        )
