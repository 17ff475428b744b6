"""EAIK: closed forms of arms whose axes meet or are parallel; every answer, of which a user picks one inside the limits.

https://eaik.cps.cit.tum.de: `HPRobot(H, P).IK(T)`; it has no settings, and knows no limits. Exact answers are taken
before those that it calls least squares, and these are not called a success.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, Refused

NAME = "EAIK"
PACKAGE = "EAIK"
RECOMMENDED: dict[str, Any] = {}
SWEEP: tuple[dict[str, Any], ...] = ()


class _Solver:
    def __init__(self, robot: Any, arm: Arm) -> None:
        self._robot = robot
        self._back = arm.home[:3, :3].T
        self._middle, self._lower, self._upper = arm.middle, arm.lower - 1e-9, arm.upper + 1e-9

    def solve(self, T: Any, start: Any) -> Answer:
        q, loose = self._inside(self._robot.IK(self._turned(T)), self._middle if start is None else start)
        if not len(q):
            return Answer(None, False)
        far = 0.0 if start is None else np.abs(q - start).max(axis=1)
        best = int((far + 1e3 * loose).argmin())
        return Answer(q[best], not loose[best])

    def branches(self, T: Array) -> Sequence[Array]:
        q, loose = self._inside(self._robot.IK(self._turned(T)), self._middle)
        return list(q[~loose])

    def batch(self, poses: Array) -> tuple[Array, Sequence[bool]]:
        turned = poses.copy()
        turned[:, :3, :3] = poses[:, :3, :3] @ self._back
        q = np.full((len(poses), len(self._middle)), np.nan)
        claimed = [False] * len(poses)
        for i, found in enumerate(self._robot.IK_batched(turned, num_worker_threads=1)):
            each, loose = self._inside(found, self._middle)
            if len(each):
                q[i], claimed[i] = each[loose.argmin()], not loose.min()
        return q, claimed

    def _turned(self, T: Any) -> Any:
        """EAIK's tip is turned as the base is, with all joints at zero."""
        turned = np.array(T, dtype=float)
        turned[:3, :3] = turned[:3, :3] @ self._back
        return turned

    def _inside(self, found: Any, near: Any) -> tuple[Array, Any]:
        """Those inside the limits, each joint within half a turn of a start where the limits allow."""
        q, loose = np.asarray(found.Q, dtype=float), np.asarray(found.is_LS, dtype=bool)
        if not len(q):
            return q.reshape(0, len(self._middle)), loose
        wrapped = near + (q - near + np.pi) % (2 * np.pi) - np.pi
        wrapped = np.where(wrapped > self._upper, wrapped - 2 * np.pi, wrapped)
        wrapped = np.where(wrapped < self._lower, wrapped + 2 * np.pi, wrapped)
        inside = ((wrapped >= self._lower) & (wrapped <= self._upper)).all(axis=1)
        return wrapped[inside], loose[inside]


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """Axes and points with all joints at zero."""
    if arm.follows or "prismatic" in arm.kinds:
        raise Refused("revolute joints only")
    if len(arm.joints) > 6:
        raise Refused("seven joints only with one of them locked")
    from eaik.IK_HP import HPRobot

    robot = HPRobot(arm.axes, np.diff(np.vstack([np.zeros(3), arm.points, arm.home[:3, 3]]), axis=0))
    if not robot.hasKnownDecomposition():
        raise Refused("no closed form known")
    return _Solver(robot, arm)
