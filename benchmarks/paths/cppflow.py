"""The problems of CppFlow, with its own validity rules.

The problems are those of the repository jstmn/cppflow (MIT; Morgan et al. 2024, *CppFlow*), some of which come from TORM
(Kang et al. 2020). The arms, a Panda and a Fetch with and without its lift, are those of jstmn/jrl (MIT), with the meshes
of their collision geometry. Neither is part of this repository: clone both, and give the folders.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml  # type: ignore[import-untyped]

import kinseek
from benchmarks.targets import Array, plain_fk, pose_errors

PROBLEMS = (
    "fetch_arm__hello",
    "fetch_arm__circle",
    "fetch_arm__rot_yz2",
    "fetch_arm__s",
    "fetch_arm__square",
    "fetch__circle",
    "fetch__hello",
    "fetch__rot_yz2",
    "fetch__s",
    "fetch__square",
    "panda__1cube",
    "panda__2cubes",
    "panda__flappy_bird",
)
"""The problems that `cppflow` evaluates."""

POSITION, ANGLE, REVOLUTE, PRISMATIC = 1e-4, np.radians(0.1), np.radians(7.0), 0.02
"""Largest errors [m], [rad] and largest steps of joints [rad], [m] of a valid path."""

FETCH = "urdfs/fetch/fetch_formatted.urdf", "base_link", "gripper_link"
ROBOTS = {
    "fetch": FETCH,
    "fetch_arm": FETCH,
    "panda": ("urdfs/panda/panda_arm_hand_formatted.urdf", "panda_link0", "panda_hand"),
}
"""File, base and tip of each arm in ``jrl``."""

MAY_TOUCH = (
    ("torso_lift_link", "torso_fixed_link"),
    ("torso_lift_link", "shoulder_lift_link"),
    ("r_gripper_finger_link", "l_gripper_finger_link"),
    ("bellows_link2", "base_link"),
    ("bellows_link2", "torso_fixed_link"),
    ("wrist_flex_link", "gripper_link"),
    ("panda_hand", "panda_link7"),
    ("panda_rightfinger", "panda_leftfinger"),
    ("panda_link7", "panda_link5"),
)
"""Pairs of links that ``jrl`` does not check because they touch or are close."""


class Problem(NamedTuple):
    """A problem: an arm, poses, and boxes."""

    arm: kinseek.Arm
    poses: Array
    """(N, 4, 4)."""
    scene: kinseek.Scene
    boxes: int
    """Boxes of the scene."""


def read(cppflow: Path, jrl: Path, name: str) -> Problem:
    """Read a problem from clones of ``cppflow`` and ``jrl``."""
    given = yaml.safe_load((cppflow / "cppflow" / "problems" / f"{name}.yaml").read_text())
    file, base, tip = ROBOTS[given["robot"]]
    folder = jrl / "jrl"
    # The files name the meshes relative to the folder.
    text = (folder / file).read_text().replace('filename="urdfs/', f'filename="{folder.resolve()}/urdfs/')
    arm = kinseek.load(text, base=base, tip=tip)
    if given["robot"] == "fetch_arm":
        arm = arm.with_locked({"torso_lift_joint": 0.0})
    frame = given["path_offset_frame"]
    offset = np.array(given["path_xyz_offset"], dtype=np.float64)
    if frame != "world":
        offset += arm.fk(np.zeros(arm.dof), link=frame)[:3, 3]
    with (cppflow / "cppflow" / "paths" / f"{given['path_name']}.csv").open() as stream:
        rows = np.array([row[1:] for row in list(csv.reader(stream))[1:]], dtype=np.float64)
    poses = np.array([kinseek.pose(row[:3] + offset, quat_wxyz=row[3:]) for row in rows])
    poses[:, :3, :3] = poses[:, :3, :3] @ np.array(given["path_R_offset"], dtype=np.float64)
    scene = kinseek.Scene.of(arm)
    for a, b in MAY_TOUCH:
        if {a, b} <= set(scene.bodies):
            scene.allow(a, b)
    obstacles = given.get("obstacles", ())
    for number, items in enumerate(obstacles):
        box: dict[str, Any] = {key: value for item in items for key, value in item.items()}
        place = np.array([box[k] for k in "xyz"]) + np.array(given["obstacle_xyz_offset"])
        scene.add_box(f"box {number}", [box[f"size_{k}"] for k in "xyz"], kinseek.pose(place))
    return Problem(arm, poses, scene, len(obstacles))


def is_valid(arm: kinseek.Arm, poses: Array, q: Array, steps: Array) -> bool:
    """Return whether a path, (N, n), keeps the rules but for collisions, by plain forward kinematics.

    Continuous joints count modulo full turns, as there.
    """
    away, angle = pose_errors(plain_fk(arm.chain, q), poses)
    endless = np.array([kind == "continuous" for kind in arm.kinds])
    inside = (endless | ((q >= arm.lower) & (q <= arm.upper))).all()
    small = (np.abs(np.diff(q, axis=0)) < steps).all()
    return bool((away < POSITION).all() and (angle < ANGLE).all() and inside and small)
