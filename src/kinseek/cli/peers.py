"""Adapters of other inverse-kinematics libraries; each is imported only if it is installed.

They get the arm's own chain instead of a file, limits, tolerances of 1e-6 or below, and restarts if they have any. They
never start from the solution: a peer that needs a start gets the middle of the ranges.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from inspect import signature
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.support.transforms import square

Array = NDArray[np.float64]
Solve = Callable[[Array], Array | None]
"""A function from a pose, (4, 4), to joint values, (n,), or None."""

TIGHT = 5e-7
"""Tolerance given to a peer, [m] and [rad]: below the one by which its results are checked."""
_RESTARTS, _STEPS = 100, 100


class Unsuitable(Exception):
    """A peer does not support this arm; the message says why."""


class Peer(NamedTuple):
    """A library."""

    name: str
    module: str
    """Name of the module to import."""
    package: str
    """Name of the package to install."""
    make: Callable[[Arm], Solve]

    @property
    def installed(self) -> bool:
        """Is it installed in this environment?"""
        return find_spec(self.module) is not None


def _plain(arm: Arm) -> list[Array]:
    """Return the frame of every joint in the previous one, and of the tip in the last, (4, 4) each; joints move along z.

    Raises:
        Unsuitable: Joints follow others.
    """
    chain = arm.chain
    if len(chain.leader) != arm.dof:
        raise Unsuitable("the arm has mimic joints")
    shifts = [np.eye(4) for _ in chain.leader]
    for k, value in enumerate(chain.offset):
        if chain.prismatic[k]:
            shifts[k][2, 3] = value
        else:
            shifts[k][:2, :2] = [[np.cos(value), -np.sin(value)], [np.sin(value), np.cos(value)]]
    fixed = [square(A) for A in chain.fixed]
    return [A @ shift for A, shift in zip(fixed, [*shifts, np.eye(4)], strict=True)]


def eaik(arm: Arm) -> Solve:
    """Compute every solution in closed form, and return the first inside the limits; exact ones precede least-squares ones.

    Raises:
        Unsuitable: Not six revolute joints, or no closed form.
    """
    if arm.dof != 6 or "prismatic" in arm.kinds:
        raise Unsuitable("it needs six revolute joints")
    frames = [np.eye(4)]
    for A in _plain(arm):
        frames.append(frames[-1] @ A)
    points = np.array([frame[:3, 3] for frame in frames])
    axes = np.array([frame[:3, 2] for frame in frames[1:7]])
    robot = import_module("eaik.IK_HP").HPRobot(axes, np.diff(points, axis=0))
    if not robot.hasKnownDecomposition():
        raise Unsuitable("the arm has no known closed form")
    turn, lower, upper = frames[-1][:3, :3].T, arm.lower - 1e-9, arm.upper + 1e-9
    middle = (lower + upper) / 2

    def solve(T: Array) -> Array | None:
        turned = T.copy()
        turned[:3, :3] = T[:3, :3] @ turn
        found = robot.IK(turned)
        q = np.asarray(found.Q)
        if not len(q):
            return None
        q = middle + (q - middle + np.pi) % (2 * np.pi) - np.pi
        inside = np.asarray(((q >= lower) & (q <= upper)).all(axis=1))
        exact = inside & ~np.asarray(found.is_LS, dtype=bool)
        first = int((exact if exact.any() else inside).argmax())
        return np.asarray(q[first]) if inside[first] else None

    return solve


def pinocchio(arm: Arm) -> Solve:
    """The Python loop of pinocchio's manual, damped, clamped to the limits, with random restarts.

    Raises:
        Unsuitable: Joints follow others.
    """
    pin = import_module("pinocchio")
    model, last = pin.Model(), 0
    frames = _plain(arm)
    for name, kind, A in zip(arm.joint_names, arm.kinds, frames[:-1], strict=True):
        moves = pin.JointModelPZ() if kind == "prismatic" else pin.JointModelRZ()
        last = model.addJoint(last, moves, pin.SE3(A), name)
    tip = model.addFrame(pin.Frame("tip", last, pin.SE3(frames[-1]), pin.FrameType.OP_FRAME))
    data, lower, upper, rng = model.createData(), arm.lower, arm.upper, np.random.default_rng(0)

    def solve(T: Array) -> Array | None:
        target, q = pin.SE3(T), (lower + upper) / 2
        for _ in range(_RESTARTS):
            for _ in range(_STEPS):
                pin.framesForwardKinematics(model, data, q)
                error = data.oMf[tip].actInv(target)
                twist = pin.log6(error).vector
                if np.linalg.norm(twist[:3]) < TIGHT and np.linalg.norm(twist[3:]) < TIGHT:
                    return q
                J = pin.Jlog6(error.inverse()) @ pin.computeFrameJacobian(model, data, q, tip)
                step = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), twist)
                q = np.clip(q + step, lower, upper)
            q = rng.uniform(lower, upper)
        return None

    return solve


def robotics_toolbox(arm: Arm) -> Solve:
    """Levenberg-Marquardt in C++ with restarts; its tolerance is on the squared error.

    Raises:
        Unsuitable: Joints follow others.
    """
    module = import_module("roboticstoolbox")
    frames, parts = _plain(arm), []
    for k, (kind, low, high) in enumerate(zip(arm.kinds, arm.lower, arm.upper, strict=True)):
        moves = module.ET.tz if kind == "prismatic" else module.ET.Rz
        parts += [module.ET.SE3(frames[k]), moves(qlim=np.array([low, high]))]
    ets, start = module.ETS([*parts, module.ET.SE3(frames[-1])]), (arm.lower + arm.upper) / 2

    def solve(T: Array) -> Array | None:
        found = ets.ik_LM(
            T, q0=start, method="chan", k=0.1, tol=1e-13, ilimit=30, slimit=_RESTARTS, joint_limits=True
        )
        return np.asarray(found[0], dtype=np.float64)

    return solve


def ikpy(arm: Arm) -> Solve:
    """SciPy's bounded least squares from the middle of the ranges, without restarts.

    Raises:
        Unsuitable: Joints follow others.
    """
    link, chain = import_module("ikpy.link"), import_module("ikpy.chain")
    frames, links = _plain(arm), [link.OriginLink()]
    names = [*arm.joint_names, "tip"]
    for k, A in enumerate(frames):
        kind = "fixed" if k == arm.dof else "prismatic" if arm.kinds[k] == "prismatic" else "revolute"
        moves = {"revolute": {"rotation": [0, 0, 1]}, "prismatic": {"translation": [0, 0, 1]}, "fixed": {}}[
            kind
        ]
        bounds = (None, None) if k == arm.dof else (arm.lower[k], arm.upper[k])
        links.append(
            link.URDFLink(
                names[k],
                bounds=bounds,
                origin_translation=A[:3, 3],
                origin_orientation=_rpy(A),
                joint_type=kind,
                **moves,
            )
        )
    whole = chain.Chain(links, active_links_mask=[False, *[True] * arm.dof, False])
    search = import_module("ikpy.inverse_kinematics").inverse_kinematic_optimization
    tight = {"tol": 1e-14} if "tol" in signature(search).parameters else {}  # Only ikpy 4 and later has this.
    start = np.concatenate([[0.0], (arm.lower + arm.upper) / 2, [0.0]])

    def solve(T: Array) -> Array | None:
        return np.asarray(
            whole.inverse_kinematics_frame(T, start, orientation_mode="all", **tight)[1:-1], dtype=np.float64
        )

    return solve


def _rpy(A: Array) -> list[float]:
    from kinseek.poses import rpy_of

    return list(rpy_of(A[:3, :3]))


PEERS = (
    Peer("EAIK", "eaik", "EAIK", eaik),
    Peer("Robotics Toolbox", "roboticstoolbox", "roboticstoolbox-python", robotics_toolbox),
    Peer("pinocchio loop", "pinocchio", "pin", pinocchio),
    Peer("ikpy", "ikpy", "ikpy", ikpy),
)
