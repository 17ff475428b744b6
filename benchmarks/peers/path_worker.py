"""One peer on paths of one arm, in its own environment: reads paths and starts, writes joint values and times.

Imports NumPy and the peer, nothing of kinseek. Peers that go from pose to pose get a start, and each pose is solved from the
answer before it, without restarts: one that fails ends there. Peers that choose among branches get none.

    python path_worker.py PEER INPUT.npz OUTPUT.npz
"""

from __future__ import annotations

import importlib
import itertools
import tempfile
import time
from collections.abc import Callable, Iterator
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from worker import arguments, elementary, limit_memory, reduced

Follow = Callable[[Any, Any], Any]
"""Poses (N, 4, 4) and a start (n,) to joint values (N, n), NaN from where nothing was found."""

LARGEST = 0.2
"""A joint that goes farther between two poses has jumped [rad]."""

ROUNDS = 40
"""Steps of a differential method at one pose, at most."""

DISTRIBUTIONS = {
    "Robotics Toolbox": "roboticstoolbox-python",
    "OptIK": "optik-py",
    "TRAC-IK": "pytracik",
    "pinocchio loop": "pin",
    "pink": "pin-pink",
    "mink": "mink",
    "Descartes": "tesseract-robotics",
    "EAIK, ladder": "EAIK",
    "ssik solve_path": "ssik",
}


def chained(step: Callable[[Any, Any], Any]) -> Follow:
    """From pose to pose: each is solved from the answer before it."""

    def follow(targets: Any, start: Any) -> Any:
        rows, q = np.full((len(targets), len(start)), np.nan), start
        for i, T in enumerate(targets):
            found = step(T, q)
            if found is None or np.abs(np.asarray(found) - q).max() > (LARGEST if i else np.inf):
                break
            rows[i] = q = np.asarray(found, dtype=float)
        return rows

    return follow


def robotics_toolbox(arm: Any) -> Follow:
    """Levenberg-Marquardt in C++; no axis can be left free along the tool, so on a raster the rotation is held."""
    module = importlib.import_module("roboticstoolbox")
    ets = elementary(module, arm)

    def step(T: Any, q: Any) -> Any:
        found = ets.ik_LM(T, q0=q, method="chan", k=0.1, tol=1e-13, ilimit=30, slimit=1, joint_limits=True)
        return found.q if found.success else None

    return chained(step)


def optik(arm: Any) -> Follow:
    """SQP from the answer before; the rotation is held."""
    module = importlib.import_module("optik")
    robot = module.Robot.from_urdf_file(str(arm["urdf"]), str(arm["base"]), str(arm["tip"]))
    robot.set_parallelism(1)
    config = module.SolverConfig("speed", max_time=0.1, max_restarts=1, tol_f=2.5e-13)

    def step(T: Any, q: Any) -> Any:
        found = robot.ik(config, T, q)
        return None if found is None else found[0]

    return chained(step)


def trac_ik(arm: Any) -> Follow:
    """KDL beside SQP from the answer before; the rotation is held. It restarts by itself: then there is a jump."""
    module = importlib.import_module("trac_ik")
    solver = module.TracIK(str(arm["base"]), str(arm["tip"]), str(arm["urdf"]), timeout=0.05, epsilon=5e-7)

    def step(T: Any, q: Any) -> Any:
        return solver.ik(T[:3, 3], T[:3, :3], q)

    return chained(step)


def pinocchio_loop(arm: Any) -> Follow:
    """The loop of pinocchio's manual, damped, with clamping; a free turn is a row left out."""
    import pinocchio as pin

    model = reduced(pin, arm)
    data, frame = model.createData(), model.getFrameId(str(arm["tip"]))
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    root, lower, upper = data.oMf[model.getFrameId(str(arm["base"]))].copy(), arm["lower"], arm["upper"]
    rows = np.arange(5 if arm["free"] else 6)
    damping = 1e-6 * np.eye(len(rows))

    def step(T: Any, q: Any) -> Any:
        target = root * pin.SE3(T)
        for _ in range(ROUNDS):
            pin.framesForwardKinematics(model, data, q)
            error = data.oMf[frame].actInv(target)
            twist = pin.log6(error).vector
            if np.linalg.norm(twist[:3]) < 1e-6 and np.linalg.norm(twist[rows[3:]]) < 1e-6:
                return q
            J = pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(model, data, q, frame)
            J = J[rows]
            q = np.clip(q + J.T @ np.linalg.solve(J @ J.T + damping, twist[rows]), lower, upper)
        return None

    return chained(step)


def pink(arm: Any) -> Follow:
    """A frame task and the limits of the joints as a quadratic programme, again and again at each pose."""
    import pinocchio as pin

    module = importlib.import_module("pink")
    tasks = importlib.import_module("pink.tasks")
    limits = importlib.import_module("pink.limits")
    model = reduced(pin, arm)
    data = model.createData()
    state = module.Configuration(model, data, pin.neutral(model))
    root = state.get_transform_frame_to_world(str(arm["base"])).copy()
    task = tasks.FrameTask(str(arm["tip"]), 1.0, [1.0, 1.0, 0.0] if arm["free"] else 1.0, lm_damping=1e-9)
    kept = [limits.ConfigurationLimit(model, config_limit_gain=1.0)]

    def step(T: Any, q: Any) -> Any:
        task.set_target(root * pin.SE3(T))
        state.update(q)
        for _ in range(ROUNDS):
            error = np.asarray(task.compute_error(state))
            if np.linalg.norm(error[:3]) < 1e-6 and np.linalg.norm(error[3 : 5 if arm["free"] else 6]) < 1e-6:
                return state.q
            v = module.solve_ik(state, [task], 1.0, solver="daqp", limits=kept, safety_break=False)
            state.update(np.clip(state.q + v, arm["lower"], arm["upper"]))
        return None

    return chained(step)


def mink(arm: Any) -> Follow:
    """The same in MuJoCo."""
    mujoco = importlib.import_module("mujoco")
    module = importlib.import_module("mink")
    model, joints = mujoco_model(mujoco, arm)
    state = module.Configuration(model)
    task = module.FrameTask(
        str(arm["tip"]), "body", 1.0, [1.0, 1.0, 0.0] if arm["free"] else 1.0, lm_damping=1e-9
    )
    limits = [module.ConfigurationLimit(model, gain=1.0)]
    root = state.get_transform_frame_to_world(str(arm["base"]), "body")

    def step(T: Any, q: Any) -> Any:
        task.set_target(root.multiply(module.SE3.from_matrix(T)))
        whole = state.q.copy()
        whole[joints] = q
        state.update(whole)
        for _ in range(ROUNDS):
            error = task.compute_error(state)
            if np.linalg.norm(error[:3]) < 1e-6 and np.linalg.norm(error[3 : 5 if arm["free"] else 6]) < 1e-6:
                return state.q[joints]
            v = module.solve_ik(state, [task], 1.0, "daqp", limits=limits)
            whole = state.q + v
            whole[joints] = np.clip(whole[joints], arm["lower"], arm["upper"])
            state.update(whole)
        return None

    return chained(step)


def mujoco_model(mujoco: Any, arm: Any) -> tuple[Any, Any]:
    """A model of MuJoCo from the arm's file, which knows no masses, and where its joints stand in q."""
    text = Path(str(arm["urdf"])).read_text(encoding="utf-8")
    options = '<mujoco><compiler boundmass="0.1" boundinertia="0.01" fusestatic="false" discardvisual="true"/></mujoco>'
    end = text.rindex("</robot>")
    model = mujoco.MjModel.from_xml_string(text[:end] + options + text[end:])
    return model, np.array([model.joint(str(name)).qposadr[0] for name in arm["joints"]])


def descartes(arm: Any) -> Follow:
    """The planner of Tesseract: a ladder of all answers that its inverse kinematics gives, and of turns about the tool.

    The closed form for the UR5e; for arms that it knows none for one numerical answer a pose.
    """
    common = importlib.import_module("tesseract_robotics.tesseract_common")
    language = importlib.import_module("tesseract_robotics.tesseract_command_language")
    planners = importlib.import_module("tesseract_robotics.tesseract_motion_planners")
    module = importlib.import_module("tesseract_robotics.tesseract_motion_planners_descartes")
    environment = importlib.import_module("tesseract_robotics.tesseract_environment").Environment()
    name, base, tip = str(arm["name"]), str(arm["base"]), str(arm["tip"])
    closed = name == "ur5e"
    solver, extra = ("URInvKin", "            model: UR5e\n") if closed else ("KDLInvKinChainLMA", "")
    folder = Path(tempfile.mkdtemp())
    (folder / "kinematics.yaml").write_text(
        "kinematic_plugins:\n  inv_kin_plugins:\n    manipulator:\n"
        f"      default: {solver}\n      plugins:\n        {solver}:\n          class: {solver}Factory\n"
        f"          config:\n            base_link: {base}\n            tip_link: {tip}\n{extra}",
        encoding="utf-8",
    )
    semantics = (
        f'<robot name="{name}" version="1.0.0"><group name="manipulator"><chain base_link="{base}" tip_link="{tip}"/>'
        f'</group><kinematics_plugin_config filename="file://{folder}/kinematics.yaml"/></robot>'
    )
    text = Path(str(arm["urdf"])).read_text(encoding="utf-8")
    if not environment.init(text, semantics, common.GeneralResourceLocator()):
        raise RuntimeError("Tesseract does not take the arm")
    info = common.ManipulatorInfo()
    info.manipulator, info.manipulator_ik_solver = "manipulator", solver
    info.working_frame, info.tcp_frame = base, tip
    planner, profile = "DescartesMotionPlannerTask", module.DescartesDefaultPlanProfileD()
    profile.allow_collision, profile.enable_collision, profile.enable_edge_collision = True, False, False
    # With both, turns and copies by whole turns, a rung has some two thousand answers and the ladder does not fit.
    profile.use_redundant_joint_solutions = not arm["free"]
    if arm["free"]:
        profile.target_pose_fixed = False
        profile.target_pose_sample_axis = np.array([0.0, 0.0, 1.0])
        profile.target_pose_sample_resolution = np.pi / 6
        profile.target_pose_sample_min, profile.target_pose_sample_max = -np.pi, np.pi - np.pi / 6
    profiles = common_or(language, common, "ProfileDictionary")()
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
        rows = []
        for instruction in answer.results.flatten():
            move = language.InstructionPoly_as_MoveInstructionPoly(instruction)
            rows.append(
                np.asarray(language.WaypointPoly_as_StateWaypointPoly(move.getWaypoint()).getPosition())
            )
        return np.array(rows).reshape(len(targets), -1)

    return follow


def common_or(first: Any, second: Any, name: str) -> Any:
    """A class of the one module, or of the other: releases of Tesseract have moved it."""
    return getattr(first, name) if hasattr(first, name) else getattr(second, name)


def eaik(arm: Any) -> Follow:
    """Every branch of every pose in closed form, and the least way through them; on a raster the rotation is held.

    Steps are short, so that a path is one of branches up to whole turns; those are chosen at the end, for all of it.
    """
    module = importlib.import_module("eaik.IK_HP")
    if len(arm["lower"]) != 6:
        raise RuntimeError("six joints only")
    robot = module.HPRobot(arm["axes"], arm["offsets"])
    if not robot.hasKnownDecomposition():
        raise RuntimeError("no closed form known")

    def follow(targets: Any, start: Any) -> Any:
        turned = targets.copy()
        turned[:, :3, :3] = targets[:, :3, :3] @ arm["turn"]
        layers = []
        for T in turned:
            found = robot.IK(T)
            good = ~np.asarray(found.is_LS, dtype=bool)
            layers.append(np.asarray(found.Q)[good])
        if not all(len(layer) for layer in layers):
            return np.full((len(targets), 6), np.nan)
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
            found = inside(
                np.array([layer[k] for layer, k in zip(layers, reversed(picks), strict=True)]), arm
            )
            if found is not None:
                return found
        return np.full((len(targets), 6), np.nan)

    return follow


def wrapped(angles: Any) -> Any:
    """Angles in [-π, π)."""
    return (angles + np.pi) % (2 * np.pi) - np.pi


def inside(rows: Any, arm: Any) -> Any:
    """A path made continuous by whole turns and moved into the limits, or None."""
    whole = rows[0] + np.concatenate(
        [np.zeros((1, rows.shape[1])), np.cumsum(wrapped(np.diff(rows, axis=0)), axis=0)]
    )
    low, high = arm["lower"] - whole.min(axis=0), arm["upper"] - whole.max(axis=0)
    turns = np.ceil((low - 1e-9) / (2 * np.pi)) * 2 * np.pi
    return whole + turns if (turns <= high + 1e-9).all() else None


def ssik(arm: Any) -> Follow:
    """Every branch of the first pose carried along the path; the shortest that stays inside the limits; rotation held."""
    module = importlib.import_module("ssik")
    robot = module.Manipulator.from_urdf(str(arm["urdf"]), base=str(arm["base"]), ee=str(arm["tip"]))
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


PEERS: dict[str, Callable[[Any], Follow]] = {
    "Robotics Toolbox": robotics_toolbox,
    "OptIK": optik,
    "TRAC-IK": trac_ik,
    "pinocchio loop": pinocchio_loop,
    "pink": pink,
    "mink": mink,
    "Descartes": descartes,
    "EAIK, ladder": eaik,
    "ssik solve_path": ssik,
}


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


def main() -> None:
    """Follow every path, from one start after another; what is not done when the time is over stays NaN."""
    name, source, destination = arguments(__doc__, PEERS)
    limit_memory(12)
    arm = dict(np.load(source, allow_pickle=False))
    follow, paths, starts = PEERS[name](arm), arm["paths"], arm["starts"]
    end = time.monotonic() + float(arm["seconds"])
    q, times = np.full((*paths.shape[:2], starts.shape[2]), np.nan), np.full(len(paths), np.nan)
    follow(paths[0][:40], starts[0][0])
    for i, targets in enumerate(paths):
        if time.monotonic() > end:
            break
        for found, cost in attempts(follow, targets, starts[i]):
            q[i], times[i] = found, cost
    np.savez(destination, q=q, times=times, version=version(DISTRIBUTIONS[name]))


if __name__ == "__main__":
    main()
