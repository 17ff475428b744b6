"""Peers that move: along paths of one arm, or one step a period behind a pose that moves.

Served by `benchmarks.workers.serve` in the peer's environment. Imports NumPy and the peer, nothing of kinseek. On paths,
peers that go from pose to pose get a start, and solve each pose from the answer before it, without restarts: one that fails
ends there. Peers that choose among branches get no start. As trackers all make one step a period, keep the limits of the
joints and their speeds by their own means, and go on from their last answer.
"""

from __future__ import annotations

import importlib
import itertools
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from typing import Any

import numpy as np

from benchmarks.field.adapters import adapter, path_of
from benchmarks.field.protocol import Arm, Stepping, Steps, arm_of

Follow = Callable[[Any, Any], Any]
"""Poses (N, 4, 4) and a start (n,) to joint values (N, n), NaN from where nothing was found."""

LARGEST = 0.2
"""A joint that goes farther between two poses has jumped [rad]."""

ROUNDS = 40
"""Steps of a differential method at one pose, at most."""

CLOSE = 1e-6
"""Where a differential method is done with a pose [m], [rad]."""

RESTARTING: dict[str, dict[str, Any]] = {
    "robotics_toolbox": {"method": "chan", "k": 0.1, "tol": 1e-13, "middle": True}
    | {"ilimit": 30, "slimit": 1, "joint_limits": True},
    "optik": {"solution_mode": "speed", "max_time": 0.1, "max_restarts": 1, "tol_f": 2.5e-13},
    "trac_ik": {"timeout": 0.05, "epsilon": 5e-7, "solver_type": "Speed"},
}
"""Adapters of the field and their settings here, without restarts where that can be chosen. None of these can leave an axis
free, so on a raster the rotation is held. TRAC-IK restarts by itself: then there is a jump."""


def field(name: str) -> Any:
    """The module of an adapter of the field."""
    return adapter(path_of(name))


class Placo:
    """A quadratic programme of a frame task with limits of joints and speeds, solved and integrated in C++."""

    def __init__(self, arm: Arm, period: float, velocity: float) -> None:
        """Of an arm, with a step in each period [s], and joints that are no faster than a velocity [rad/s]."""
        module = importlib.import_module("placo")
        self._robot = robot = module.RobotWrapper(arm.urdf, module.Flags.ignore_collisions)
        self._names = arm.joints
        robot.set_velocity_limits(velocity)
        self._solver = solver = module.KinematicsSolver(robot)
        solver.mask_fbase(True)
        solver.enable_joint_limits(True)
        solver.enable_velocity_limits(True)
        solver.dt = period
        solver.add_regularization_task(1e-6)
        robot.update_kinematics()
        self._root = robot.get_T_world_frame(arm.base).copy()
        self._task = solver.add_frame_task(arm.tip, self._root)
        self._task.configure("hand", "soft", 1.0, 1.0)

    def stand(self, q: Any) -> None:
        """Begin there."""
        for name, value in zip(self._names, q, strict=True):
            self._robot.set_joint(name, float(value))
        self._robot.update_kinematics()

    def aim(self, T: Any) -> None:
        """Take a pose for the target."""
        self._task.T_world_frame = self._root @ T

    def step(self) -> None:
        """One period on."""
        self._solver.solve(True)
        self._robot.update_kinematics()

    @property
    def q(self) -> Any:
        """Where it stands."""
        return np.array([self._robot.get_joint(name) for name in self._names])


class Drake:
    """Differential inverse kinematics that keeps the direction of the hand and slows it down."""

    def __init__(self, arm: Arm, period: float, velocity: float) -> None:
        """As of `Placo`."""
        from pydrake.math import RotationMatrix
        from pydrake.multibody import inverse_kinematics
        from pydrake.multibody.tree import JacobianWrtVariable

        self._module, self._rotation, self._kind = inverse_kinematics, RotationMatrix, JacobianWrtVariable.kV
        self._plant, self._base, self._tip, self._columns = field("drake").plant_of(arm)
        self._context = self._plant.CreateDefaultContext()
        self._order, self._period = np.argsort(self._columns), period
        speeds = np.full(self._plant.num_velocities(), velocity)
        self._set = inverse_kinematics.DifferentialInverseKinematicsParameters(len(speeds), len(speeds))
        self._set.set_time_step(period)
        self._set.set_joint_position_limits((arm.lower[self._order], arm.upper[self._order]))
        self._set.set_joint_velocity_limits((-speeds, speeds))

    def stand(self, q: Any) -> None:
        """Begin there."""
        self._q, self._v = np.asarray(q)[self._order], np.zeros(len(q))

    def aim(self, T: Any) -> None:
        """Take a pose for the target."""
        self._target = T

    def step(self) -> None:
        """One period on."""
        plant, context = self._plant, self._context
        plant.SetPositions(context, self._q)
        here = plant.CalcRelativeTransform(context, self._base, self._tip)
        turn = self._rotation(self._target[:3, :3] @ here.rotation().matrix().T).ToAngleAxis()
        V = np.concatenate([turn.axis() * turn.angle(), self._target[:3, 3] - here.translation()])
        J = plant.CalcJacobianSpatialVelocity(
            context, self._kind, self._tip, np.zeros(3), self._base, self._base
        )
        found = self._module.DoDifferentialInverseKinematics(self._q, self._v, V / self._period, J, self._set)
        if found.joint_velocities is not None:
            self._v = found.joint_velocities
            self._q = self._q + self._v * self._period

    @property
    def q(self) -> Any:
        """Where it stands."""
        return self._q[self._columns]


def chained(solver: Any) -> Follow:
    """From pose to pose: each is solved from the answer before it."""

    def follow(targets: Any, start: Any) -> Any:
        rows, q = np.full((len(targets), len(start)), np.nan), start
        for i, T in enumerate(targets):
            answer = solver.solve(T, q)
            if not answer.claimed or np.abs(np.asarray(answer.q) - q).max() > (LARGEST if i else np.inf):
                break
            rows[i] = q = np.asarray(answer.q, dtype=float)
        return rows

    return follow


def solving(name: str) -> Callable[[Arm, bool], Follow]:
    """A solver of the field, with the settings of `RESTARTING`."""
    return lambda arm, free: chained(field(name).load(arm, RESTARTING[name]))


def stepping(
    name: str,
    arm: Arm,
    free: bool,
    period: float = 1.0,
    velocity: float = 0.0,
    acceleration: float | None = None,
) -> Steps:
    """A differential method of the field, with a step in each period [s]; a velocity of 0 is none.

    The loop of pinocchio's manual is damped, with clamping, and a fast step is scaled down. pink and mink solve their
    quadratic programmes; pink alone can limit accelerations.
    """
    module, damping = field(name), 1e-6 if velocity else 1e-9
    made: Steps
    if name == "pinocchio":
        made = module.Loop(arm, 1e-6, free=free, longest=period * velocity if velocity else np.inf)
    elif name == "pink":
        limits = {"velocity": velocity or False, "acceleration": acceleration}
        made = module.Pink(arm, period, damping, free=free, **limits)
    else:
        made = module.Mink(arm, period, damping, velocity or None, free=free)
    return made


class Differential(Stepping):
    """Steps of a differential method, again and again at each pose."""

    def __init__(self, name: str, arm: Arm, free: bool) -> None:
        """Of an arm; with a free turn about the tool, that part of the error does not count."""
        settings = {"restarts": 0, "steps": ROUNDS, "tolerance": CLOSE}
        super().__init__(arm, stepping(name, arm, free), settings)
        self._counted = 5 if free else 6

    def far(self, error: Any) -> float:
        """The larger error of place and turn."""
        return super().far(error[: self._counted])


def differential(name: str) -> Callable[[Arm, bool], Follow]:
    """Paths of a differential method."""
    return lambda arm, free: chained(Differential(name, arm, free))


def descartes(arm: Arm, free: bool) -> Follow:
    """The planner of Tesseract: a ladder of all answers that its inverse kinematics gives, and of turns about the tool.

    The closed form for the UR5e; for arms of which it knows none, one numerical answer a pose.
    """
    common = importlib.import_module("tesseract_robotics.tesseract_common")
    language = importlib.import_module("tesseract_robotics.tesseract_command_language")
    planners = importlib.import_module("tesseract_robotics.tesseract_motion_planners")
    module = importlib.import_module("tesseract_robotics.tesseract_motion_planners_descartes")
    closed = arm.name == "ur5e"
    solver, told = ("URInvKin", {"model": "UR5e"}) if closed else ("KDLInvKinChainLMA", {})
    environment = field("kdl").environment_of(arm, solver, told)
    info = common.ManipulatorInfo()
    info.manipulator, info.manipulator_ik_solver = "manipulator", solver
    info.working_frame, info.tcp_frame = arm.base, arm.tip
    planner, profile = "DescartesMotionPlannerTask", module.DescartesDefaultPlanProfileD()
    profile.allow_collision, profile.enable_collision, profile.enable_edge_collision = True, False, False
    # With both, turns and copies by whole turns, a rung has some two thousand answers and the ladder does not fit.
    profile.use_redundant_joint_solutions = not free
    if free:
        profile.target_pose_fixed = False
        profile.target_pose_sample_axis = np.array([0.0, 0.0, 1.0])
        profile.target_pose_sample_resolution = np.pi / 6
        profile.target_pose_sample_min, profile.target_pose_sample_max = -np.pi, np.pi - np.pi / 6
    profiles = language.ProfileDictionary()
    profiles.addProfile(planner, "P", module.cast_DescartesPlanProfileD(profile))

    def follow(targets: Any, start: Any) -> Any:
        program = language.CompositeInstruction()
        program.setManipulatorInfo(info)
        for T in targets:
            waypoint = language.CartesianWaypoint(common.Isometry3d(np.ascontiguousarray(T)))
            move = language.MoveInstruction(
                language.CartesianWaypointPoly_wrap_CartesianWaypoint(waypoint),
                language.MoveInstructionType_LINEAR,
                "P",
                info,
            )
            program.appendMoveInstruction(language.MoveInstructionPoly_wrap_MoveInstruction(move))
        request = planners.PlannerRequest()
        request.instructions, request.env, request.profiles = program, environment, profiles
        answer = module.DescartesMotionPlannerD(planner).solve(request)
        if not answer.successful:
            return np.full((len(targets), len(start)), np.nan)
        moves = map(language.InstructionPoly_as_MoveInstructionPoly, answer.results.flatten())
        states = (language.WaypointPoly_as_StateWaypointPoly(move.getWaypoint()) for move in moves)
        return np.array([np.asarray(state.getPosition()) for state in states]).reshape(len(targets), -1)

    return follow


def ladder(arm: Arm, free: bool) -> Follow:
    """Every branch of every pose by EAIK, and the least way through them; on a raster the rotation is held.

    Steps are short, so that a path is one of branches up to whole turns; those are chosen at the end, for all of it.
    """
    solver: Any = field("eaik").load(arm, {})

    def follow(targets: Any, start: Any) -> Any:
        layers = [np.array(solver.branches(T)) for T in targets]
        if not all(len(layer) for layer in layers):
            return np.full((len(targets), len(start)), np.nan)
        cost, back = np.zeros(len(layers[0])), []
        for before, here in itertools.pairwise(layers):
            gap = wrapped(here[None] - before[:, None])
            way = np.where(np.abs(gap).max(axis=2) < LARGEST, np.linalg.norm(gap, axis=2), np.inf)
            total = cost[:, None] + way
            back.append(total.argmin(axis=0))
            cost = total.min(axis=0)
        for last in np.argsort(cost):
            if not np.isfinite(cost[last]):
                break
            picks = [int(last)]
            for row in reversed(back):
                picks.append(int(row[picks[-1]]))
            rows = np.array([layer[k] for layer, k in zip(layers, reversed(picks), strict=True)])
            if (found := inside(rows, arm)) is not None:
                return found
        return np.full((len(targets), len(start)), np.nan)

    return follow


def wrapped(angles: Any) -> Any:
    """Angles in [-π, π)."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def inside(rows: Any, arm: Arm) -> Any:
    """A path made continuous by whole turns and moved into the limits, or None."""
    steps = np.cumsum(wrapped(np.diff(rows, axis=0)), axis=0)
    whole = rows[0] + np.concatenate([np.zeros((1, rows.shape[1])), steps])
    low, high = arm.lower - whole.min(axis=0), arm.upper - whole.max(axis=0)
    turns = np.ceil((low - 1e-9) / (2 * np.pi)) * 2 * np.pi
    return whole + turns if (turns <= high + 1e-9).all() else None


def ssik(arm: Arm, free: bool) -> Follow:
    """Every branch of the first pose carried along the path; the shortest that stays inside the limits; rotation held."""
    module = importlib.import_module("ssik")
    robot = module.Manipulator.from_urdf(arm.urdf, base=arm.base, ee=arm.tip)
    robot.prepare()

    def follow(targets: Any, start: Any) -> Any:
        found = robot.solve_path(targets, max_step=LARGEST)
        good = []
        for steps in found.tracks.values():
            rows = np.array([step.q for step in steps])
            if len(rows) == len(targets) and np.isfinite(rows).all():
                rows = inside(rows, arm)
                if rows is not None and np.abs(np.diff(rows, axis=0)).max() < LARGEST:
                    good.append(rows)
        if not good:
            return np.full((len(targets), len(start)), np.nan)
        return min(good, key=lambda rows: np.linalg.norm(np.diff(rows, axis=0), axis=1).sum())

    return follow


FOLLOWERS: dict[str, tuple[str, str, Callable[[Arm, bool], Follow]]] = {
    "Robotics Toolbox": ("robotics_toolbox", "roboticstoolbox-python", solving("robotics_toolbox")),
    "OptIK": ("optik", "optik-py", solving("optik")),
    "TRAC-IK": ("trac_ik", "pytracik", solving("trac_ik")),
    "pinocchio loop": ("pinocchio", "pin", differential("pinocchio")),
    "pink": ("pink", "pin-pink", differential("pink")),
    "mink": ("mink", "mink", differential("mink")),
    "Descartes": ("kdl", "tesseract-robotics", descartes),
    "EAIK, ladder": ("eaik", "EAIK", ladder),
    "ssik solve_path": ("ssik", "ssik", ssik),
}
"""Of each the adapter of the field whose environment it has, its distribution, and what makes it."""

TRACKERS: dict[str, tuple[str, str, Callable[..., Any]]] = {
    "placo": ("placo", "placo", Placo),
    "pink": ("pink", "pin-pink", lambda arm, *limits: stepping("pink", arm, False, *limits)),
    "mink": ("mink", "mink", lambda arm, *limits: stepping("mink", arm, False, *limits)),
    "Drake": ("drake", "drake", Drake),
    "pinocchio step": ("pinocchio", "pin", lambda arm, *limits: stepping("pinocchio", arm, False, *limits)),
}
"""Of each the adapter of the field whose environment it has, its distribution, and what makes it of an arm, a period, a
velocity and, where it is in `ACCELERATING`, an acceleration."""

TRACK = "benchmarks.workers.motion", "track", 900
"""What is called, and how long it may take [s]."""

ACCELERATING = ("pink",)
"""Trackers that can limit accelerations."""


def attempts(follow: Follow, targets: Any, starts: Any) -> Iterator[tuple[Any, float]]:
    """Joint values and the processor's time of a waypoint [µs] for one start after another, until one leads to the end."""
    for start in starts:
        began = time.process_time_ns()
        q = follow(targets, start)
        # What goes from pose to pose ends where it fails; what chooses among branches has looked at all.
        done = int(np.isfinite(q).all(axis=1).sum()) or len(q)
        yield q, (time.process_time_ns() - began) / 1e3 / done
        if np.isfinite(q).all() and np.abs(np.diff(q, axis=0)).max() < LARGEST:
            return


def follow(
    peer: str, arm: dict[str, Any], paths: Any, starts: Any, free: bool, seconds: float
) -> dict[str, Any]:
    """Follow every path, (P, N, 4, 4), from starts, (P, k, n), one after another; what is not done in time stays NaN."""
    paths, starts = np.array(paths), np.array(starts)
    one = FOLLOWERS[peer][2](arm_of(arm), free)
    end = time.monotonic() + seconds
    q, times = np.full((*paths.shape[:2], starts.shape[2]), np.nan), np.full(len(paths), np.nan)
    one(paths[0][:40], starts[0][0])
    for i, targets in enumerate(paths):
        if time.monotonic() > end:
            break
        for found, cost in attempts(one, targets, starts[i]):
            q[i], times[i] = found, cost
    return {"q": q, "times": times, "version": version(FOLLOWERS[peer][1])}


def track(
    peer: str,
    arm: dict[str, Any],
    paths: Any,
    starts: Any,
    period: float,
    velocity: float,
    acceleration: float | None = None,
) -> dict[str, Any]:
    """Track each of P paths, (N, 4, 4), from its start, (n,): joint values, and the time of every step [µs], a list each.

    An acceleration [rad/s²] is for those that can limit it. One that finds no step stands still (`stood`).
    """
    limits = [velocity] if acceleration is None or peer not in ACCELERATING else [velocity, acceleration]
    method = TRACKERS[peer][2](arm_of(arm), period, *limits)
    made: dict[str, list[list[Any]]] = {"q": [], "times": [], "stood": []}
    for targets, start in zip(paths, starts, strict=True):
        method.stand(np.array(start))
        for column in made.values():
            column.append([])
        for T in np.array(targets):
            began, stands = time.perf_counter_ns(), False
            method.aim(T)
            try:
                method.step()
            except Exception:  # Each has its own, of a quadratic programme without a solution.
                stands = True
                method.stand(method.q)
            row = method.q, (time.perf_counter_ns() - began) / 1e3, stands
            for column, value in zip(made.values(), row, strict=True):
                column[-1].append(value)
    return made | {"version": version(TRACKERS[peer][1])}
