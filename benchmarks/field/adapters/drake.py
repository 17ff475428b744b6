"""Drake: the class `InverseKinematics`, a nonlinear programme with constraints of place and turn, solved by SNOPT.

https://drake.mit.edu, pydrake.multibody.inverse_kinematics: its manual leaves the bounds to the user. As first settings half
a millimetre each way and 0.005 rad, from one guess; in the sweep narrow bounds, kept more closely, and random guesses.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, Refused

NAME = "Drake"
PACKAGE = "drake"
RECOMMENDED: dict[str, Any] = {"place": 5e-4, "turn": 5e-3, "guesses": 1, "feasible": None}
SWEEP: tuple[dict[str, Any], ...] = (
    {"place": 1e-7, "turn": 1e-7, "guesses": 20, "feasible": None},
    {"place": 0.0, "turn": 0.0, "guesses": 20, "feasible": 1e-13},
    {"place": 1e-8, "turn": 3e-7, "guesses": 20, "feasible": 1e-14},
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        from pydrake.math import RotationMatrix
        from pydrake.multibody.inverse_kinematics import InverseKinematics
        from pydrake.multibody.parsing import Parser
        from pydrake.multibody.plant import MultibodyPlant
        from pydrake.solvers import SnoptSolver, SolverOptions

        self._plant = plant = MultibodyPlant(time_step=0.0)
        Parser(plant).AddModels(arm.urdf)
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(arm.base))
        plant.Finalize()
        if plant.num_positions() != len(arm.joints):
            raise Refused(f"reads {plant.num_positions()} joints of {len(arm.joints)}")
        self._order = [plant.GetJointByName(name).position_start() for name in arm.joints]
        self._tip, self._base = plant.GetFrameByName(arm.tip), plant.GetFrameByName(arm.base)
        self._context = plant.CreateDefaultContext()
        self._problem, self._snopt, self._turn = InverseKinematics, SnoptSolver(), RotationMatrix
        self._options = SolverOptions()
        if settings["feasible"]:
            self._options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", settings["feasible"])
        self._arm, self._set, self._rng = arm, settings, np.random.default_rng(0)

    def solve(self, T: Any, start: Any) -> Answer:
        return self._asked(T, T[:3, 3], start)

    def position(self, place: Array, start: Array | None) -> Answer:
        return self._asked(None, place, start)

    def _asked(self, T: Any, place: Array, start: Any) -> Answer:
        asked = self._problem(self._plant, self._context)
        near = np.full(3, self._set["place"])
        asked.AddPositionConstraint(self._tip, np.zeros(3), self._base, place - near, place + near)
        if T is not None:
            turn = self._turn(np.array(T[:3, :3]))
            asked.AddOrientationConstraint(self._base, turn, self._tip, self._turn(), self._set["turn"])
        guess = self._arm.middle if start is None else np.asarray(start, dtype=float)
        programme = asked.prog()
        for guesses_left in reversed(range(self._set["guesses"])):
            values = np.empty(len(guess))
            values[self._order] = guess
            found = self._snopt.Solve(programme, values, self._options)
            if found.is_success() or not guesses_left:
                break
            guess = self._rng.uniform(self._arm.lower, self._arm.upper)
        return Answer(found.GetSolution(asked.q())[self._order], bool(found.is_success()))


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """The file itself, its base welded to the world."""
    if arm.follows:
        raise Refused("joints that follow others are not kept")
    return _Solver(arm, settings)
