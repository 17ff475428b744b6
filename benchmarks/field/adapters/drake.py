"""Drake: the class `InverseKinematics`, a nonlinear programme with constraints of place and turn, solved by SNOPT.

https://drake.mit.edu, pydrake.multibody.inverse_kinematics: its manual leaves the bounds to the user. As first settings half
a millimetre each way and 0.005 rad, from one guess; in the sweep narrow bounds, kept more closely, and random guesses.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, Refused, Restarting

NAME = "Drake"
PACKAGE = "drake"
RECOMMENDED: dict[str, Any] = {"place": 5e-4, "turn": 5e-3, "guesses": 1, "feasible": None}
SWEEP: tuple[dict[str, Any], ...] = (
    {"place": 1e-7, "turn": 1e-7, "guesses": 20, "feasible": None},
    {"place": 0.0, "turn": 0.0, "guesses": 20, "feasible": 1e-13},
    {"place": 1e-8, "turn": 3e-7, "guesses": 20, "feasible": 1e-14},
)


class _Solver(Restarting):
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        from pydrake.math import RotationMatrix
        from pydrake.multibody.inverse_kinematics import InverseKinematics
        from pydrake.solvers import SnoptSolver, SolverOptions

        super().__init__(arm, settings["guesses"])
        self._plant, self._base, self._tip, self._order = plant_of(arm)
        self._context = self._plant.CreateDefaultContext()
        self._problem, self._snopt, self._turn = InverseKinematics, SnoptSolver(), RotationMatrix
        self._options, self._set = SolverOptions(), settings
        if settings["feasible"]:
            self._options.SetOption(SnoptSolver.id(), "Major feasibility tolerance", settings["feasible"])

    def solve(self, T: Any, start: Any) -> Answer:
        return self.descended(self._asked(T[:3, 3], T[:3, :3]), start)

    def position(self, place: Array, start: Array | None) -> Answer:
        return self.descended(self._asked(place, None), start)

    def _asked(self, place: Array, turn: Array | None) -> Any:
        asked = self._problem(self._plant, self._context)
        near = np.full(3, self._set["place"])
        asked.AddPositionConstraint(self._tip, np.zeros(3), self._base, place - near, place + near)
        if turn is not None:
            turned = self._turn(np.array(turn))
            asked.AddOrientationConstraint(self._base, turned, self._tip, self._turn(), self._set["turn"])
        return asked

    def descend(self, goal: Any, q: Array) -> Answer:
        guess = np.empty(len(q))
        guess[self._order] = q
        found = self._snopt.Solve(goal.prog(), guess, self._options)
        return Answer(found.GetSolution(goal.q())[self._order], bool(found.is_success()))


def plant_of(arm: Arm) -> tuple[Any, Any, Any, list[int]]:
    """The file itself, its base welded to the world: the plant, the frames of base and tip, and the places of the joints."""
    from pydrake.multibody.parsing import Parser
    from pydrake.multibody.plant import MultibodyPlant

    plant = MultibodyPlant(time_step=0.0)
    Parser(plant).AddModels(arm.urdf)
    base, tip = plant.GetFrameByName(arm.base), plant.GetFrameByName(arm.tip)
    plant.WeldFrames(plant.world_frame(), base)
    plant.Finalize()
    if plant.num_positions() != len(arm.joints):
        raise Refused(f"reads {plant.num_positions()} joints of {len(arm.joints)}")
    return plant, base, tip, [plant.GetJointByName(name).position_start() for name in arm.joints]


load = _Solver
