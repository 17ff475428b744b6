"""One peer as a tracker of one arm, in its own environment: one period after another, one pose in, joint values out.

Imports NumPy and the peer, nothing of kinseek. Every peer makes one step a period, keeps the limits of the joints and their
speeds by its own means, and goes on from what it answered.

    python servo_worker.py PEER INPUT.npz OUTPUT.npz
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from path_worker import mujoco_model
from worker import arguments, limit_memory, reduced

Step = Callable[[Any], Any]
"""A pose to joint values (n,), one period on."""

Begin = Callable[[Any], Step]
"""Joint values to begin with to a tracker that stands there."""

DISTRIBUTIONS = {
    "placo": "placo",
    "pink": "pin-pink",
    "mink": "mink",
    "Drake": "drake",
    "pinocchio step": "pin",
}


def placo(arm: Any) -> Begin:
    """A quadratic programme of a frame task with limits of joints and speeds, solved and integrated in C++."""
    module = importlib.import_module("placo")
    robot = module.RobotWrapper(str(arm["urdf"]), module.Flags.ignore_collisions)
    names = [str(name) for name in arm["joints"]]
    robot.set_velocity_limits(float(arm["velocity"]))
    solver = module.KinematicsSolver(robot)
    solver.mask_fbase(True)
    solver.enable_joint_limits(True)
    solver.enable_velocity_limits(True)
    solver.dt = float(arm["period"])
    solver.add_regularization_task(1e-6)
    robot.update_kinematics()
    root = robot.get_T_world_frame(str(arm["base"])).copy()
    task = solver.add_frame_task(str(arm["tip"]), root)
    task.configure("hand", "soft", 1.0, 1.0)

    def begin(q0: Any) -> Step:
        for name, value in zip(names, q0, strict=True):
            robot.set_joint(name, float(value))
        robot.update_kinematics()

        def step(T: Any) -> Any:
            task.T_world_frame = root @ T
            solver.solve(True)
            robot.update_kinematics()
            return np.array([robot.get_joint(name) for name in names])

        return step

    return begin


def pink(arm: Any) -> Begin:
    """A frame task, limits of joints and of speeds as a quadratic programme."""
    import pinocchio as pin

    module = importlib.import_module("pink")
    tasks = importlib.import_module("pink.tasks")
    limits = importlib.import_module("pink.limits")
    model, period = reduced(pin, arm), float(arm["period"])
    model.velocityLimit = np.full(model.nv, float(arm["velocity"]))
    state = module.Configuration(model, model.createData(), pin.neutral(model))
    root = state.get_transform_frame_to_world(str(arm["base"])).copy()
    task = tasks.FrameTask(str(arm["tip"]), 1.0, 1.0, lm_damping=1e-6)
    kept = [limits.ConfigurationLimit(model, config_limit_gain=1.0), limits.VelocityLimit(model)]

    def begin(q0: Any) -> Step:
        state.update(q0)

        def step(T: Any) -> Any:
            task.set_target(root * pin.SE3(T))
            v = module.solve_ik(state, [task], period, solver="daqp", limits=kept, safety_break=False)
            state.integrate_inplace(v, period)
            return state.q

        return step

    return begin


def mink(arm: Any) -> Begin:
    """The same in MuJoCo."""
    mujoco = importlib.import_module("mujoco")
    module = importlib.import_module("mink")
    model, joints = mujoco_model(mujoco, arm)
    period = float(arm["period"])
    state = module.Configuration(model)
    task = module.FrameTask(str(arm["tip"]), "body", 1.0, 1.0, lm_damping=1e-6)
    speeds = {str(name): float(arm["velocity"]) for name in arm["joints"]}
    kept = [module.ConfigurationLimit(model, gain=1.0), module.VelocityLimit(model, speeds)]
    root = state.get_transform_frame_to_world(str(arm["base"]), "body")

    def begin(q0: Any) -> Step:
        whole = state.q.copy()
        whole[joints] = q0
        state.update(whole)

        def step(T: Any) -> Any:
            task.set_target(root.multiply(module.SE3.from_matrix(T)))
            v = module.solve_ik(state, [task], period, "daqp", limits=kept)
            state.integrate_inplace(v, period)
            return state.q[joints].copy()

        return step

    return begin


def drake(arm: Any) -> Begin:
    """Differential inverse kinematics that keeps the direction of the hand and slows it down."""
    module = importlib.import_module("pydrake.multibody.inverse_kinematics")
    plants = importlib.import_module("pydrake.multibody.plant")
    parsing = importlib.import_module("pydrake.multibody.parsing")
    transforms = importlib.import_module("pydrake.math")
    tree = importlib.import_module("pydrake.multibody.tree")
    plant, period = plants.MultibodyPlant(0.0), float(arm["period"])
    parsing.Parser(plant).AddModelsFromString(Path(str(arm["urdf"])).read_text(encoding="utf-8"), "urdf")
    base, tip = plant.GetFrameByName(str(arm["base"])), plant.GetFrameByName(str(arm["tip"]))
    plant.WeldFrames(plant.world_frame(), base)
    plant.Finalize()
    context = plant.CreateDefaultContext()
    columns = [plant.GetJointByName(str(name)).position_start() for name in arm["joints"]]
    order = np.argsort(columns)
    speeds = np.full(plant.num_velocities(), float(arm["velocity"]))
    parameters = module.DifferentialInverseKinematicsParameters(plant.num_positions(), plant.num_velocities())
    parameters.set_time_step(period)
    parameters.set_joint_position_limits((arm["lower"][order], arm["upper"][order]))
    parameters.set_joint_velocity_limits((-speeds, speeds))

    def begin(q0: Any) -> Step:
        held = {"q": np.asarray(q0)[order], "v": np.zeros(len(q0))}

        def step(T: Any) -> Any:
            q = held["q"]
            plant.SetPositions(context, q)
            here = plant.CalcRelativeTransform(context, base, tip)
            turn = transforms.RotationMatrix(T[:3, :3] @ here.rotation().matrix().T).ToAngleAxis()
            V = np.concatenate([turn.axis() * turn.angle(), T[:3, 3] - here.translation()]) / period
            J = plant.CalcJacobianSpatialVelocity(
                context, tree.JacobianWrtVariable.kV, tip, np.zeros(3), base, base
            )
            found = module.DoDifferentialInverseKinematics(q, held["v"], V, J, parameters)
            if found.joint_velocities is not None:
                held["v"] = found.joint_velocities
                held["q"] = q + held["v"] * period
            return held["q"][columns]

        return step

    return begin


def pinocchio_step(arm: Any) -> Begin:
    """One damped step a period, scaled down to the speeds and clamped to the limits."""
    import pinocchio as pin

    model = reduced(pin, arm)
    data, frame = model.createData(), model.getFrameId(str(arm["tip"]))
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    root = data.oMf[model.getFrameId(str(arm["base"]))].copy()
    reach, damping = float(arm["velocity"] * arm["period"]), 1e-6 * np.eye(6)

    def begin(q0: Any) -> Step:
        held = [np.asarray(q0)]

        def step(T: Any) -> Any:
            q = held[0]
            pin.framesForwardKinematics(model, data, q)
            error = data.oMf[frame].actInv(root * pin.SE3(T))
            J = pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(model, data, q, frame)
            move = J.T @ np.linalg.solve(J @ J.T + damping, pin.log6(error).vector)
            move *= min(1.0, reach / max(float(np.abs(move).max()), 1e-12))
            held[0] = np.clip(q + move, arm["lower"], arm["upper"])
            return held[0]

        return step

    return begin


PEERS: dict[str, Callable[[Any], Begin]] = {
    "placo": placo,
    "pink": pink,
    "mink": mink,
    "Drake": drake,
    "pinocchio step": pinocchio_step,
}


def main() -> None:
    """Track every path from its start; write joint values and the time of every step [µs]."""
    name, source, destination = arguments(__doc__, PEERS)
    limit_memory(12)
    arm = dict(np.load(source, allow_pickle=False))
    begin, paths, starts = PEERS[name](arm), arm["paths"], arm["starts"]
    q = np.empty((*paths.shape[:2], starts.shape[1]))
    times = np.empty(paths.shape[:2])
    for row, targets, start in zip(np.arange(len(paths)), paths, starts, strict=True):
        step = begin(start)
        for k, T in enumerate(targets):
            began = time.perf_counter_ns()
            q[row, k] = step(T)
            times[row, k] = (time.perf_counter_ns() - began) / 1e3
    np.savez(destination, q=q, times=times, version=version(DISTRIBUTIONS[name]))


if __name__ == "__main__":
    main()
