"""What one peer hands back for goals that are out of reach: joint values or nothing, and what it says of them.

Runs in the peer's environment, beside `worker.py`, whose settings it shares; here nothing that a peer returns is dropped.

    python unreachable_worker.py PEER INPUT.npz OUTPUT.npz
"""

from __future__ import annotations

import importlib
from collections.abc import Callable
from typing import Any

import numpy as np
from worker import PEERS, elementary, reduced, work

SOLVED, APPROXIMATE, NOTHING = 2, 1, 0
"""Joint values said to be an answer, joint values said to be none, no joint values."""

Answer = tuple[Any, int]


def eaik(arm: Any) -> Callable[[Any], Answer]:
    """Every branch, of which the first is taken: those inside the limits before others, then exact ones by EAIK's flag."""
    module = importlib.import_module("eaik.IK_HP")
    robot = module.HPRobot(arm["axes"], arm["offsets"])
    if not robot.hasKnownDecomposition():
        raise RuntimeError("no closed form known")
    middle = (arm["lower"] + arm["upper"]) / 2

    def solve(T: Any) -> Answer:
        turned = T.copy()
        turned[:3, :3] = T[:3, :3] @ arm["turn"]
        found = robot.IK(turned)
        q = np.asarray(found.Q)
        if not len(q):
            return None, NOTHING
        q = middle + (q - middle + np.pi) % (2 * np.pi) - np.pi
        loose = np.asarray(found.is_LS, dtype=bool)
        inside = ((q >= arm["lower"]) & (q <= arm["upper"])).all(axis=1)
        order = np.lexsort((loose, ~inside))
        return q[order[0]], APPROXIMATE if loose[order[0]] else SOLVED

    return solve


def robotics_toolbox(arm: Any) -> Callable[[Any], Answer]:
    """Levenberg-Marquardt with restarts: it returns where it ended, and a flag."""
    module = importlib.import_module("roboticstoolbox")
    ets, start = elementary(module, arm), (arm["lower"] + arm["upper"]) / 2

    def solve(T: Any) -> Answer:
        found = ets.ik_LM(
            T,
            q0=start,
            method="chan",
            k=0.1,
            tol=1e-13,
            ilimit=30,
            slimit=100,
            joint_limits=True,
        )
        return found.q, SOLVED if found.success else APPROXIMATE

    return solve


def pinocchio_loop(arm: Any) -> Callable[[Any], Answer]:
    """The loop of pinocchio's manual as printed, limits aside: 1,000 steps, then where it ended and a flag."""
    import pinocchio as pin

    model = reduced(pin, arm)
    data = model.createData()
    frame, base = model.getFrameId(str(arm["tip"])), model.getFrameId(str(arm["base"]))
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    root = data.oMf[base].copy()

    def solve(T: Any) -> Answer:
        target, q = root * pin.SE3(T), (arm["lower"] + arm["upper"]) / 2
        for _ in range(1000):
            pin.framesForwardKinematics(model, data, q)
            error = data.oMf[frame].actInv(target)
            twist = pin.log6(error).vector
            if np.linalg.norm(twist) < 1e-4:
                return q, SOLVED
            J = pin.computeFrameJacobian(model, data, q, frame)
            J = -pin.Jlog6(error.inverse()) @ J
            v = -J.T @ np.linalg.solve(J @ J.T + 1e-12 * np.eye(6), twist)
            q = pin.integrate(model, q, v * 0.1)
        return q, APPROXIMATE

    return solve


def plainly(name: str) -> Callable[[Any], Callable[[Any], Answer]]:
    """A peer that returns joint values or nothing."""

    def make(arm: Any) -> Callable[[Any], Answer]:
        solve = PEERS[name](arm)

        def wrapped(T: Any) -> Answer:
            q = solve(T)
            return (None, NOTHING) if q is None else (q, SOLVED)

        return wrapped

    return make


RAW: dict[str, Callable[[Any], Callable[[Any], Answer]]] = {
    "EAIK": eaik,
    "ssik": plainly("ssik"),
    "OptIK": plainly("OptIK"),
    "TRAC-IK": plainly("TRAC-IK"),
    "Robotics Toolbox": robotics_toolbox,
    "pinocchio loop": pinocchio_loop,
}


def main() -> None:
    """Ask for one answer a target, and what the peer says of it."""
    work(__doc__, RAW, 5, lambda answer: answer)


if __name__ == "__main__":
    main()
