"""Serial chains, joint values and poses for tests: random chains for hypothesis, and joint values where arms are awkward."""

from __future__ import annotations

import numpy as np
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek.robots.chain import SerialChain
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import rotation, transform

Array = NDArray[np.float64]

NUMBER = st.floats(-1, 1, allow_subnormal=False)


@st.composite
def unit_vectors(draw: st.DrawFn) -> Array:
    vector = np.array([draw(NUMBER), draw(NUMBER), draw(NUMBER)])
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.1 else np.array([0.0, 0.0, 1.0])


@st.composite
def poses(draw: st.DrawFn) -> Array:
    place = np.array([draw(NUMBER), draw(NUMBER), draw(NUMBER)])
    return transform(rotation(draw(unit_vectors()), 3 * draw(NUMBER)), place)


@st.composite
def serial_chains(draw: st.DrawFn, most: int = 5) -> SerialChain:
    """Up to `most` variables, some of them with a follower."""
    joints = []
    for i in range(draw(st.integers(1, most))):
        kind = draw(st.sampled_from(["revolute", "continuous", "prismatic"]))
        lower = draw(st.floats(-4, 2))
        width = draw(st.floats(0, 6))
        joints.append(Joint(f"j{i}", kind, draw(poses()), draw(unit_vectors()), lower, lower + width))
    for follower in range(draw(st.integers(0, 2))):
        leader = draw(st.sampled_from([joint.name for joint in joints if joint.mimic is None]))
        where = draw(st.integers(0, len(joints)))
        kind = draw(st.sampled_from(["revolute", "prismatic"]))
        multiplier = draw(st.sampled_from([-2.0, -1.0, -0.3, 0.5, 1.0]))
        joint = Joint(
            f"m{follower}",
            kind,
            draw(poses()),
            draw(unit_vectors()),
            0.0,
            0.0,
            leader,
            multiplier,
            draw(NUMBER),
        )
        joints.insert(where, joint)
    return serial_chain(joints, draw(poses()), name="random", base="base", tip="tip")


def random_poses(arm: kinseek.Arm, count: int, seed: int = 0) -> np.ndarray:
    """Poses of an arm with joint values anywhere inside its limits, (count, 4, 4)."""
    return arm.fk(np.random.default_rng(seed).uniform(arm.lower, arm.upper, (count, arm.dof)))


def beside(T: Array, position: float, orientation: float, seed: int) -> Array:
    """A pose in a ball around each of some, (k, 4, 4), half of them at its rim: so far off [m] and [rad]."""
    rng = np.random.default_rng(seed)
    moved = T.copy()
    way, axis = rng.normal(size=(2, len(T), 3))
    far, angle = np.minimum(rng.uniform(0.0, 2.0, (2, len(T))), 1.0)
    moved[:, :3, 3] += (position * far / np.linalg.norm(way, axis=1))[:, None] * way
    turn = (orientation * angle / np.linalg.norm(axis, axis=1))[:, None] * axis
    moved[:, :3, :3] = Rotation.from_rotvec(turn).as_matrix() @ T[:, :3, :3]
    return np.asarray(moved)


def awkward_joints(chain: SerialChain, rng: np.random.Generator) -> Array:
    """Random, often at a limit, often at a multiple of a quarter turn, where arms are singular."""
    q = rng.uniform(chain.lower, chain.upper)
    choice = rng.random(chain.dof)
    q = np.where(choice < 0.1, chain.lower, np.where(choice < 0.2, chain.upper, q))
    if rng.random() < 0.3:
        quarter = np.clip(np.round(q / (np.pi / 2)) * np.pi / 2, chain.lower, chain.upper)
        q = np.where(rng.random(chain.dof) < 0.5, quarter, q)
    return np.asarray(q)


def wide_panda() -> kinseek.Arm:
    """The Panda with the hard limits of its description in moveit_resources, which lie beyond those of its maker.

    Poses that were once difficult were found with these limits, at joint values that the bundled arm does not reach.
    """
    chain = kinseek.load("panda").chain
    lower = np.array([-2.9671, -1.8326, -2.9671, -3.1416, -2.9671, -0.0873, -2.9671])
    upper = np.array([2.9671, 1.8326, 2.9671, 0.0873, 2.9671, 3.8223, 2.9671])
    return kinseek.Arm(chain.limited(lower, upper, chain.kinds))
