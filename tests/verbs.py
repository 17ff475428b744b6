"""Every public call that gives joint values for poses, in one form: what each of them promises is tested on all of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from importlib.util import find_spec
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import kinseek

Array = NDArray[np.float64]

ARMS = ("planar2", "cylindrical3", "scara4", "so101", "ur5e", "panda", "ur10e_rail")
"""2 to 7 joints, slides and full turns among them."""


POSTURES: dict[str, dict[str, Any]] = {"ur5e": {"elbow": "down"}, "panda": {"arm_angle": 0.5}}
"""A posture of arms that have names for it."""


class Told(NamedTuple):
    """What a call said of some poses."""

    q: Array
    """(k, n)"""
    success: NDArray[np.bool_]
    """(k,)"""
    poses: Array
    """What each row was asked to reach, (k, 4, 4)."""


@cache
def arm_of(name: str) -> kinseek.Arm:
    """A bundled arm, loaded once."""
    return kinseek.load(name)


@cache
def scene_of(name: str) -> Any:
    """A scene with a board beside the arm."""
    arm = arm_of(name)
    scene = kinseek.Scene.of(arm, capsules=0.02)
    far = 0.6 * float(np.abs(arm.fk(arm.sample(50, seed=0))[:, :3, 3]).max())
    scene.add_box("board", size=(0.02, 0.4, 0.4), pose=kinseek.pose([far, 0, far]))
    return scene


def _solutions(solution: kinseek.Solution, poses: Array) -> Told:
    q = np.atleast_2d(solution.q)
    return Told(q, np.atleast_1d(np.asarray(solution.success)), poses)


def _one_by_one(arm: kinseek.Arm, poses: Array, **options: Any) -> Told:
    found = [arm.ik(pose, **options) for pose in poses]
    return Told(np.array([one.q for one in found]), np.array([bool(one.success) for one in found]), poses)


def _branches(arm: kinseek.Arm, poses: Array, **options: Any) -> Told:
    """Every branch is a success by its nature."""
    rows, owners = [], []
    for pose in poses:
        found = arm.branches(pose, **options)
        rows.extend(found.q)
        owners.extend([pose] * len(found.q))
    q = np.array(rows).reshape(-1, arm.dof)
    return Told(q, np.ones(len(q), dtype=np.bool_), np.array(owners).reshape(-1, 4, 4))


def _followed(arm: kinseek.Arm, poses: Array, **options: Any) -> Told:
    # From each pose to the next in ten small steps: the first half of them is a path.
    path = arm.follow(poses, max_step=10.0, **options)
    return Told(path.q, path.reached, poses)


def _tracked(arm: kinseek.Arm, poses: Array) -> Told:
    first = arm.ik(poses[0])
    tracker = arm.track(first.q, period=0.01, velocity=2.0)
    steps = [tracker.step(pose) for pose in poses for _ in range(5)]
    told = kinseek.TrackStatus.TRACKING
    return Told(
        np.array([step.q.copy() for step in steps]),
        np.array([step.status is told for step in steps]),
        np.repeat(poses, 5, axis=0),
    )


def _moved(arm: kinseek.Arm, poses: Array) -> Told:
    """A pose is reached by a motion in time, from the middle of the ranges."""
    middle, rows, reached = (arm.lower + arm.upper) / 2.0, [], []
    for pose in poses[:3]:
        try:
            motion = arm.move(middle, pose, velocity=1.0, acceleration=5.0)
            rows.append(motion.q(motion.duration))
            reached.append(True)
        except kinseek.NotReached as error:
            rows.append(error.solution.q)
            reached.append(False)
    return Told(np.array(rows), np.array(reached), poses[:3])


def _planned(arm: kinseek.Arm, poses: Array) -> Told:
    """The ends of motions around the board to poses, from joint values that are free."""
    scene, rows, reached = scene_of(arm.name), [], []
    # The second: from the first of ur5e no way leads out, and all samples are tried for half of the poses.
    _, begin, *_ = (q for q in arm.sample(20, seed=2) if scene.free(q))
    for pose in poses[:2]:
        try:
            path = scene.plan(begin, pose, smooth=False)
            rows.append(path.q[-1])
            reached.append(True)
        except kinseek.NotReached as error:
            rows.append(error.solution.q)
            reached.append(False)
    return Told(np.array(rows), np.array(reached), poses[:2])


def _searched(solver: kinseek.Solver) -> Callable[[kinseek.Arm, Array], Told]:
    return lambda arm, poses: _solutions(arm.ik(poses[:2], solver=solver), poses[:2])


VERBS: dict[str, Callable[[kinseek.Arm, Array], Told]] = {
    "ik": _one_by_one,
    "ik, a batch": lambda arm, poses: _solutions(arm.ik(poses), poses),
    "ik, near": lambda arm, poses: _one_by_one(arm, poses, near=arm.upper),
    "ik, a batch near": lambda arm, poses: _solutions(arm.ik(poses, near=arm.lower), poses),
    "ik, preferred": lambda arm, poses: _one_by_one(arm, poses[:3], prefer="mid-range"),
    "ik, at a posture": lambda arm, poses: _one_by_one(
        arm, poses[:3], prefer=POSTURES.get(arm.name, "limits")
    ),
    "ik, valid": lambda arm, poses: _one_by_one(arm, poses[:3], valid=lambda q: bool(q[0] <= arm.upper[0])),
    "branches": _branches,
    "branches, full turns": lambda arm, poses: _branches(arm, poses, copies=True),
    "follow": _followed,
    "follow, a time limit": lambda arm, poses: _followed(arm, poses, time_limit=1e6),
    "track": _tracked,
    "divide and conquer": _searched(kinseek.DivideAndConquer(breadth=1)),
    "brute force": _searched(kinseek.BruteForce(branching_factor=3)),
    "coordinate descent": _searched(kinseek.CoordinateDescent()),
    "blind search": _searched(kinseek.BlindSearch(most_steps=10)),
    "polished": _searched(kinseek.Polished()),
}
if find_spec("ruckig") is not None:
    VERBS["move"] = _moved
if find_spec("coal") is not None:
    VERBS["plan in a scene"] = _planned
    VERBS["ik in a scene"] = lambda arm, poses: _one_by_one(arm, poses[:2], scene=scene_of(arm.name))


def asked(arm: kinseek.Arm, seed: int, count: int = 6) -> Array:
    """Poses that are reached, some at limits, some a little out of reach, (count, 4, 4)."""
    rng = np.random.default_rng(seed)
    q = arm.lower + rng.random((count, arm.dof)) * (arm.upper - arm.lower)
    q = np.where(rng.random(q.shape) < 0.1, np.where(rng.random(q.shape) < 0.5, arm.lower, arm.upper), q)
    poses = arm.fk(q)
    poses[-1, :3, 3] *= rng.uniform(0.5, 2.0)
    return np.asarray(poses)
