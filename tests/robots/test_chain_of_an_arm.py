"""What an arm tells of its chain: derivatives, the poses of its links, names, samples, and its text."""

from __future__ import annotations

import copy
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import kinseek
from chains import serial_chains
from kinseek import Arm, InvalidProblem, InvalidRobot, InvalidSolver
from kinseek.robots import catalog_names, catalog_path
from kinseek.robots.chain import SerialChain
from pinocchio_poses import configuration
from reference import fk

Array = NDArray[np.float64]

pinocchio = pytest.importorskip("pinocchio")


def model_of(name: str) -> tuple[Any, Any]:
    model = pinocchio.buildModelFromXML(catalog_path(name).read_text(), mimic=True)
    return model, model.createData()


# --- derivatives ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", catalog_names())
def test_the_jacobian_is_pinocchios(name: str) -> None:
    arm, (model, data) = kinseek.load(name), model_of(name)
    tip = model.getFrameId(arm.tip, pinocchio.FrameType.BODY)
    base = model.getFrameId(arm.base, pinocchio.FrameType.BODY)
    for q in arm.sample(5, seed=1):
        at = configuration(pinocchio, model, arm.joint_names, q)
        columns = [model.joints[model.getJointId(joint)].idx_v for joint in arm.joint_names]
        theirs = pinocchio.computeFrameJacobian(model, data, at, tip, pinocchio.LOCAL_WORLD_ALIGNED)[
            :, columns
        ]
        pinocchio.framesForwardKinematics(model, data, at)
        turn = data.oMf[base].rotation.T
        np.testing.assert_allclose(arm.jacobian(q)[:3], turn @ theirs[:3], rtol=0, atol=1e-12)
        np.testing.assert_allclose(arm.jacobian(q)[3:], turn @ theirs[3:], rtol=0, atol=1e-12)
        if arm.dof >= 6:
            measure = np.sqrt(np.linalg.det(theirs @ theirs.T))  # Yoshikawa 1985, eq. 3
            assert arm.manipulability(q) == pytest.approx(measure, rel=1e-9)


@pytest.mark.slow
@given(serial_chains(), st.integers(0, 2**32 - 1))
@settings(max_examples=60)
def test_the_jacobian_is_the_derivative_of_fk(chain: SerialChain, seed: int) -> None:
    arm = Arm(chain).with_tool(kinseek.pose([0.1, -0.2, 0.3], rotvec=[0.3, 0.2, 1.0]))
    q, step = np.random.default_rng(seed).uniform(-3, 3, chain.dof), 1e-5
    J = arm.jacobian(q)
    for i, way in enumerate(np.eye(chain.dof) * step):
        rate = (fk(arm.chain, q + way) - fk(arm.chain, q - way)) / (2 * step)
        spin = rate[:3, :3] @ fk(arm.chain, q)[:3, :3].T
        turned = [spin[2, 1], spin[0, 2], spin[1, 0]]
        np.testing.assert_allclose(J[:, i], [*rate[:3, 3], *turned], rtol=0, atol=1e-8)


def test_jacobians_and_manipulability_have_the_shape_of_the_batch() -> None:
    arm = kinseek.load("panda")
    q = arm.sample(6).reshape(2, 3, 7)
    assert arm.jacobian(q).shape == (2, 3, 6, 7)
    np.testing.assert_array_equal(arm.jacobian(q)[1, 2], arm.jacobian(q[1, 2]))
    assert arm.manipulability(q).shape == (2, 3)
    assert isinstance(arm.manipulability(q[0, 0]), float)
    assert arm.manipulability(q[1, 2]) == pytest.approx(arm.manipulability(q)[1, 2], rel=1e-12)
    assert arm.jacobian(np.zeros((0, 7))).shape == (0, 6, 7)
    with pytest.raises(InvalidProblem, match=r"q must have shape \(7,\)"):
        arm.jacobian([0.0])


def test_a_planar_arm_is_measured_in_its_plane() -> None:
    arm = Arm.from_dh([[0.5, 0, 0, 0], [0.25, 0, 0, 0]], [-3, -3], [3, 3])
    # Two columns, (0, r, 1) each about its own axis: the singular values of the 3 x 2 matrix, by hand.
    q = np.array([0.0, np.pi / 2])
    plane = np.array([[-0.25, -0.25], [0.5, 0.0], [1.0, 1.0]])
    assert arm.manipulability(q) == pytest.approx(np.sqrt(np.linalg.det(plane.T @ plane)), rel=1e-12)


# --- links ----------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", catalog_names())
def test_every_link_and_joint_stands_where_pinocchio_has_it(name: str) -> None:
    arm, (model, data) = kinseek.load(name), model_of(name)
    base = model.getFrameId(arm.base, pinocchio.FrameType.BODY)
    q = arm.sample(3, seed=2)
    seen = 0
    for k in range(len(q)):
        at = configuration(pinocchio, model, arm.joint_names, q[k])
        pinocchio.framesForwardKinematics(model, data, at)
        for frame in arm.chain.frames:
            kinds = [pinocchio.FrameType.BODY, pinocchio.FrameType.JOINT, pinocchio.FrameType.FIXED_JOINT]
            kind = next(kind for kind in kinds if model.existFrame(frame, kind))
            pose = data.oMf[base].actInv(data.oMf[model.getFrameId(frame, kind)]).homogeneous
            np.testing.assert_allclose(arm.fk(q, link=frame)[k], pose, rtol=0, atol=1e-12, err_msg=frame)
            seen += 1
    assert seen >= 3 * (2 * arm.dof + 1)  # Base, and of every joint itself and the link that it moves.


def test_a_tool_moves_the_tip_and_no_link() -> None:
    arm = kinseek.load("ur5e")
    tool = kinseek.pose([0.0, 0.05, 0.2], rpy=[0.1, 0.2, 0.3])
    q = arm.sample(50)
    tooled = arm.with_tool(tool)
    np.testing.assert_allclose(tooled.fk(q), arm.fk(q) @ tool, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(tooled.fk(q, link=tooled.tip), arm.fk(q))
    assert tooled.ik(arm.fk(q) @ tool).success.all()
    with pytest.raises(kinseek.InvalidGoal, match="tool: "):
        arm.with_tool(np.zeros((4, 4)))


def test_rows_of_a_table_are_links_of_both_conventions() -> None:
    rows = [[0.3, 0.4, 0.1, 0.2], [0.2, -0.5, 0.3, 0.1], [0.1, 0.6, 0.2, -0.3]]
    base, tool = kinseek.pose([1, 2, 3], rpy=[0.1, 0.2, 0.3]), kinseek.pose([0, 0, 0.5])
    for convention in ("standard", "modified"):
        options: dict[str, Any] = {"convention": convention, "base": base, "tool": tool}
        arm = Arm.from_dh(rows, [-3] * 3, [3] * 3, **options)
        q = np.array([0.3, -0.8, 1.1])
        for k in (1, 2, 3):
            part = Arm.from_dh(rows[:k], [-3] * k, [3] * k, convention=convention, base=base)
            np.testing.assert_allclose(arm.fk(q, link=f"link{k}"), part.fk(q[:k]), rtol=0, atol=1e-14)
        np.testing.assert_array_equal(arm.fk(q, link="base"), np.eye(4))
        np.testing.assert_allclose(arm.fk(q, link="tool"), arm.fk(q), rtol=0, atol=1e-14)


def test_frames_of_an_mjcf_file_are_mujocos(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    from test_mjcf import TREE, frame_pose

    path = tmp_path / "m.xml"
    path.write_text(TREE.format(angle="radian"))
    spec = mujoco.MjSpec.from_string(
        TREE.format(angle="radian").replace('<geom type="mesh" mesh="lost"/>', '<geom size="0.1"/>')
    )
    for element in [*spec.meshes, *spec.textures]:
        spec.delete(element)
    model = spec.compile()
    data = mujoco.MjData(model)
    arm = kinseek.load(path, tip="hand")
    q = arm.sample(3, seed=4)
    for k in range(len(q)):
        for joint, value in zip(arm.joint_names, q[k], strict=True):
            data.qpos[model.joint(joint).qposadr[0]] = value
        mujoco.mj_kinematics(model, data)
        for frame in ("one", "two", "hand"):
            np.testing.assert_allclose(arm.fk(q, link=frame)[k], frame_pose(data, frame), rtol=0, atol=1e-12)
        for joint in arm.joint_names:
            at = arm.fk(q, link=joint)[k]
            if model.joint(joint).type[0] != mujoco.mjtJoint.mjJNT_SLIDE:
                np.testing.assert_allclose(at[:3, 3], data.joint(joint).xanchor, rtol=0, atol=1e-12)


def test_an_unknown_link_is_told_what_there_is() -> None:
    arm = kinseek.load("panda")
    with pytest.raises(
        InvalidProblem, match=r"unknown link or joint 'panda_lnk7'; did you mean 'panda_link7'"
    ):
        arm.fk(np.zeros(7), link="panda_lnk7")
    with pytest.raises(InvalidProblem, match=r"unknown link or joint '\[\]'"):
        arm.fk(np.zeros(7), link=[])  # type: ignore[call-overload]


# --- names, samples, text -------------------------------------------------------------------------------------------


def test_names_and_kinds() -> None:
    arm = kinseek.load("gen3")
    assert (arm.base, arm.tip, arm.kinds) == (arm.chain.base, arm.chain.tip, arm.chain.kinds)
    assert set(arm.kinds) == {"revolute", "continuous"}


@given(serial_chains(), st.integers(0, 2**31), st.integers(0, 40))
@settings(max_examples=40)
def test_samples_lie_inside_the_limits_and_come_again(chain: SerialChain, seed: int, n: int) -> None:
    arm = Arm(chain)
    q = arm.sample(n, seed)
    assert q.shape == (n, arm.dof)
    assert ((q >= arm.lower) & (q <= arm.upper)).all()
    np.testing.assert_array_equal(q, arm.sample(n, seed=seed))


def test_samples_are_spread_evenly() -> None:
    arm = kinseek.load("ur10e_rail")
    shares = (arm.sample(20_000, seed=7) - arm.lower) / (arm.upper - arm.lower)
    for i in range(arm.dof):
        counts = np.histogram(shares[:, i], bins=10, range=(0, 1))[0]
        assert np.abs(counts - 2000).max() < 6 * np.sqrt(2000 * 0.9)  # Six standard deviations.
    assert np.abs(np.corrcoef(shares.T) - np.eye(arm.dof)).max() < 6 / np.sqrt(20_000)


@pytest.mark.parametrize(("n", "seed"), [(-1, 0), (2.0, 0), (True, 0), (3, -1), (3, None), (3, "a")])
def test_samples_refuse_what_is_no_number(n: Any, seed: Any) -> None:
    with pytest.raises(InvalidProblem, match="must be a whole number of at least 0"):
        kinseek.load("scara4").sample(n, seed)


def test_the_text_of_an_arm_shows_its_tool_and_its_locks() -> None:
    arm = kinseek.load("panda")
    assert repr(arm) == "Arm('panda', 7 joints, 'panda_link0' -> 'panda_link8')"
    changed = arm.with_tool(np.eye(4)).with_locked({"panda_joint3": 0.5}).with_locked({"panda_joint1": 0.25})
    assert repr(changed) == (
        "Arm('panda', 5 joints, 'panda_link0' -> 'panda_link8' + tool, "
        "panda_joint3 locked at 0.5, panda_joint1 locked at 0.25)"
    )
    assert repr(arm.with_limits({"panda_joint1": (0, 1)})) == repr(arm)
    assert repr(Named(arm.chain, "left")).startswith("Named('panda'")


@pytest.mark.parametrize(
    "call",
    [
        lambda arm: arm.jacobian([0.1]),
        lambda arm: arm.manipulability([0.1]),
        lambda arm: arm.fk([0.1], link="tip"),
        lambda arm: arm.with_tool(np.eye(4)),
        lambda arm: arm.with_locked({"joint1": 0.1}),
    ],
)
def test_a_function_says_what_it_has_not(call: Any) -> None:
    arm = Arm.from_fk(slide, [0.0], [1.0], name="slide")
    with pytest.raises(InvalidProblem, match=r"ax[ei]s|link.*'slide' has black-box kinematics"):
        call(arm)
    assert (arm.kinds, arm.base, arm.tip) == (("number",), "base", "tip")
    assert arm.sample(3).shape == (3, 1)
    assert repr(arm) == "Arm('slide', 1 joint, 'base' -> 'tip')"


def slide(q: Array) -> Array:
    T = np.tile(np.eye(4), (len(q), 1, 1))
    T[:, 2, 3] = q[:, 0]
    return T


# --- subclasses -----------------------------------------------------------------------------------------------------


class Named(Arm):
    """An arm with an attribute of its own, and another `__init__`."""

    def __init__(self, chain: SerialChain, side: str, *, colour: str = "grey") -> None:
        super().__init__(chain)
        self.side, self.colour = side, colour


class Slotted(Arm):
    """One whose attribute lies in a slot."""

    __slots__ = ("side",)

    def __init__(self, side: str) -> None:
        super().__init__(kinseek.load("ur5e").chain)
        self.side = side


@pytest.mark.slow
@pytest.mark.parametrize(
    "make", [lambda: Named(kinseek.load("ur5e").chain, "left", colour="red"), lambda: Slotted("left")]
)
@pytest.mark.parametrize(
    "change",
    [
        copy.copy,
        copy.deepcopy,
        lambda arm: pickle.loads(pickle.dumps(arm)),
        lambda arm: arm.with_tool(np.eye(4)),
        lambda arm: arm.with_locked({arm.joint_names[0]: 0.0}),
        lambda arm: arm.with_limits({arm.joint_names[0]: (-1.0, 1.0)}),
    ],
)
def test_subclasses_keep_what_is_theirs(make: Any, change: Any) -> None:
    arm = make()
    arm.ik(arm.fk(np.full(6, 0.3)))  # So that it has an atlas, which must not be handed on.
    other = change(arm)
    assert type(other) is type(arm)
    assert other.side == "left"
    assert getattr(other, "colour", "red") == "red"
    q = np.full(other.dof, 0.2)
    assert other.ik(other.fk(q)).success


def test_a_changed_arm_does_not_change_the_first() -> None:
    arm = kinseek.load("ur5e")
    q = np.full(6, 0.3)
    before = arm.fk(q)
    arm.branches(before)
    tooled = arm.with_tool(kinseek.pose([0, 0, 1.0]))
    assert len(tooled.branches(tooled.fk(q))) > 0
    np.testing.assert_array_equal(arm.fk(q), before)
    assert arm.ik(before).success


# --- threads --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("threads", [0, -1, 1.5, "2", np.inf])
@pytest.mark.parametrize("poses", [1, 3])
def test_threads_are_refused_alike_for_one_and_for_many(threads: Any, poses: int) -> None:
    arm = kinseek.load("scara4")
    T = arm.fk(arm.sample(poses)) if poses > 1 else arm.fk(arm.sample(1)[0])
    for call in (
        lambda: arm.ik(T, threads=threads),
        lambda: arm.ik(T, threads=threads, solver=kinseek.CoordinateDescent()),
        lambda: arm.ik(T, threads=threads, prefer="limits"),
        lambda: arm.branches(T, threads=threads),
        lambda: arm.branches(T, threads=threads, order="limits"),
        lambda: arm.prove(T, threads=threads),
    ):
        with pytest.raises(InvalidSolver, match="threads must be"):
            call()
    if poses > 1:
        assert arm.ik(T, threads=2).success.all()


def test_locking_nothing_and_unknown_joints() -> None:
    arm = kinseek.load("scara4")
    with pytest.raises(InvalidRobot, match="unknown joint 'wing'"):
        arm.with_locked({"wing": 0.0})
    assert repr(arm.with_locked({})) == repr(arm)
