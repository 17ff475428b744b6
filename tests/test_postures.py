"""Postures by name: read, told apart, requested; and the arm angle, against its definition."""

from __future__ import annotations

import itertools
import math
import pickle
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Branches, Goal
from kinseek.kernels.arrays import Array
from kinseek.postures import NAMES, turns_of
from kinseek.structure.arm_angle import BEHIND, REFERENCE, ArmAngle, arm_angle_of
from kinseek.structure.axes import axes_of, displaced, foot
from kinseek.structure.signs import signs_of

SIX = ("ur5e", "ur10e", "puma560", "irb120", "kr6r900", "mh180", "elbow6", "lite6", "wx250s")
"""Arms with a closed form that holds exactly, of each kind."""

SEVEN = ("panda", "iiwa14", "gen3", "xarm7")

FLAGS = tuple(NAMES)


def words_of(configuration: dict[str, Any]) -> list[tuple[str, ...]]:
    return list(zip(*(configuration[name].tolist() for name in FLAGS), strict=True))


def branches_of(arm: kinseek.Arm, q: Array) -> Branches:
    found = arm.branches(arm.fk(q))
    assert isinstance(found, Branches)
    return found


@pytest.mark.parametrize("name", SIX)
def test_different_solutions_have_different_names(name: str) -> None:
    arm, most = kinseek.load(name), 0
    for q in arm.sample(60, seed=2):
        branches = branches_of(arm, q)
        words = words_of(branches.configuration)
        assert len(set(words)) == len(words) == len(branches)
        most = max(most, len(words))
    if name in ("ur5e", "ur10e", "elbow6"):
        assert most == 8


@pytest.mark.parametrize("value", [0.0, 0.7])
def test_seven_joints_of_which_one_is_locked(value: float) -> None:
    """Axes 2 and 3 of what is left are not parallel."""
    arm = kinseek.load("iiwa14").with_locked({"joint_a3": value})
    for q in arm.sample(30, seed=1):
        words = words_of(branches_of(arm, q).configuration)
        assert len(set(words)) == len(words) > 0


@pytest.mark.parametrize("name", SIX)
def test_the_names_change_at_singularities_only(name: str) -> None:
    """The determinant of the Jacobian is the product of the three numbers, up to one factor of the arm."""
    arm = kinseek.load(name)
    signs, q = signs_of(arm.chain.arrays, arm.structure), arm.sample(200, seed=4)
    assert signs is not None
    values = signs.values(q)
    product = np.abs(values[:, 0]) * np.sign(values[:, 0]) ** 2 * values[:, 1] * values[:, 2]
    factors = np.linalg.det(arm.jacobian(q)) / product
    np.testing.assert_allclose(factors, factors[0], rtol=1e-3)


def place(arm: kinseek.Arm, q: Array, link: str) -> Array:
    return arm.fk(q, link=link)[..., :3, 3]


@pytest.mark.parametrize(
    ("name", "links"),
    [
        ("ur5e", ("upper_arm_link", "forearm_link", "wrist_1_link")),
        ("puma560", ("link3", "link4", "link6")),
        ("irb120", ("link_2", "link_3", "link_5")),
        ("kr6r900", ("link_2", "link_3", "link_5")),
    ],
)
def test_up_and_front_mean_what_they_say(name: str, links: tuple[str, str, str]) -> None:
    arm = kinseek.load(name)
    q = arm.sample(300, seed=6)
    configuration = arm.ik(arm.fk(q), near=q).configuration
    shoulder, elbow, end = (place(arm, q, link) for link in links)
    # Horizontal, and normal to axis 2; the arm at q = 0 says which of both directions.
    rows = np.concatenate([np.zeros((1, 6)), q])
    front = np.cross([0.0, 0.0, 1.0], arm.jacobian(rows)[:, 3:, 1])
    front *= np.sign(front[0] @ place(arm, rows[:1], links[2])[0])
    reach = (front[1:] * end).sum(axis=1)
    # The wrist and the end of the forearm may lie on different sides of axis 1 if they are close to it.
    clear = np.abs(reach) > 0.25
    assert clear.sum() > 50
    expected = np.where(reach > 0.0, "front", "back")
    np.testing.assert_array_equal(configuration["shoulder"][clear], expected[clear])
    # Height of the elbow above the line from shoulder to wrist, measured in the vertical plane of the arm.
    along, upper = end - shoulder, elbow - shoulder
    flat, flat_upper = ((front[1:] * each).sum(axis=1) for each in (along, upper))
    clear &= (np.abs(flat) > 0.1) & (np.sign(flat) == np.sign(reach))
    height = upper[clear, 2] - along[clear, 2] * flat_upper[clear] / flat[clear]
    assert (np.abs(height) > 1e-3).sum() > 50
    expected = np.where(height > 0.0, "up", "down")
    np.testing.assert_array_equal(configuration["elbow"][clear], expected)


def test_the_wrist_is_named_after_joint_5() -> None:
    for name in ("ur5e", "irb120", "kr6r900", "puma560"):
        arm = kinseek.load(name)
        q = arm.sample(50, seed=1)
        words = arm.ik(arm.fk(q), near=q).configuration["wrist"]
        np.testing.assert_array_equal(words, np.where(np.sin(q[:, 4]) >= 0.0, "noflip", "flip"))


def test_on_the_border_between_two_names_the_first_is_read_and_both_are_met() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 0.0, 0.5])
    solution = arm.ik(arm.fk(q), near=q)
    assert solution.configuration["wrist"] == "noflip"
    for wrist in NAMES["wrist"]:
        again = arm.ik(arm.fk(q), near=q, prefer={"wrist": wrist})
        assert again.success
        assert again.q[4] == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("name", ["ur5e", "irb120", "ur10e_calibrated"])
def test_every_solution_is_returned_by_its_names(name: str) -> None:
    arm = kinseek.load(name)
    q = arm.lower * 0.35 + arm.upper * 0.65 - 0.1
    branches = branches_of(arm, q)
    assert len(branches) > 1
    for i, words in enumerate(words_of(branches.configuration)):
        wanted = dict(zip(FLAGS, words, strict=True))
        solution = arm.ik(branches.problem.goal, prefer=wanted)
        assert solution.success
        np.testing.assert_allclose(solution.q, branches.q[i], atol=1e-8)
        assert wanted.items() <= solution.configuration.items()


def test_the_most_names_win_then_the_order() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 0.7, 0.5])
    T, branches = arm.fk(q), branches_of(arm, q)
    words = branches.configuration
    up = np.flatnonzero(words["elbow"] == "up")
    np.testing.assert_array_equal(arm.ik(T, prefer={"elbow": "up"}).q, branches.q[up[0]])
    near = branches.q[up[-1]] + 0.05
    np.testing.assert_allclose(arm.ik(T, near=near, prefer={"elbow": "up"}).q, branches.q[up[-1]], atol=1e-9)

    def first_joint(rows: Array) -> Array:
        return np.asarray(rows[:, 0])

    least = arm.ik(T, cost=first_joint, prefer={"elbow": "up"})
    assert least.configuration["elbow"] == "up"
    copies = arm.branches(T, copies=True, count=1000)
    ups = copies.q[copies.configuration["elbow"] == "up"]  # type: ignore[union-attr]
    assert least.q[0] == pytest.approx(ups[:, 0].min())

    def never_up(one: Array) -> bool:
        return bool(arm.ik(T, near=one).configuration["elbow"] == "down")

    # `valid` decides; the posture is a preference.
    down = arm.ik(T, prefer={"elbow": "up"}, valid=never_up)
    assert down.success
    assert down.configuration["elbow"] == "down"
    assert down.rejected == len(up)
    # A posture that the limits exclude.
    narrow = arm.with_limits({"elbow_joint": (0.0, 3.0)})
    wanted = {"elbow": "down", "shoulder": "front"}
    assert wanted.items() <= arm.ik(T, prefer=wanted).configuration.items()
    other = narrow.ik(T, prefer=wanted)
    assert other.success
    assert [other.configuration[name] == word for name, word in wanted.items()].count(True) == 1


def test_batches_and_pickles() -> None:
    arm = kinseek.load("ur5e")
    q = arm.sample(6, seed=3).reshape(2, 3, 6)
    batch = arm.ik(arm.fk(q), near=q)
    configuration = batch.configuration
    assert configuration["elbow"].shape == (2, 3)
    for i in np.ndindex(2, 3):
        one = batch[i].configuration
        assert {name: one[name] for name in FLAGS} == {name: configuration[name][i] for name in FLAGS}
        assert isinstance(one["elbow"], str)
    assert pickle.loads(pickle.dumps(batch)).configuration.keys() == configuration.keys()
    up = arm.ik(arm.fk(q), prefer={"elbow": "up", "shoulder": "front"})
    assert up.configuration["elbow"].shape == (2, 3)
    poses = arm.fk(q).copy()
    poses[0, 1] = np.nan
    assert arm.ik(poses, bad="skip").configuration["elbow"][0, 1] == ""


def test_full_turns() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3 - 2 * np.pi, -1.2, 1.4, -0.8, 0.7, 0.5 - 2 * np.pi])
    T = arm.fk(q)
    near = arm.ik(T, near=q)
    read = near.configuration
    assert read["turns"]["wrist_3_joint"] == -1
    assert read["turns"]["wrist_1_joint"] == 0
    again = arm.ik(T, prefer=read)
    np.testing.assert_allclose(again.q, near.q, atol=1e-9)
    assert again.configuration == read
    one = arm.ik(T, prefer={"turns": {"wrist_3_joint": 0}})
    assert one.q[5] == pytest.approx(0.5) or turns_of(one.q[5:6])[0] == 0
    assert turns_of(np.array([-math.pi, 0.0, math.pi, math.pi + 1e-9, -4.0, 7.0])).tolist() == [
        -1,
        0,
        0,
        1,
        -1,
        1,
    ]
    assert (
        "turns" not in kinseek.load("puma560").ik(kinseek.load("puma560").fk(np.full(6, 0.2))).configuration
    )


def test_an_arm_angle_and_full_turns() -> None:
    arm = kinseek.load("xarm7")
    q = np.array([-0.3 + math.tau, -0.4, 0.2, 1.2, 0.3 - math.tau, 0.9, 0.5])
    solution = arm.ik(arm.fk(q), near=q)
    read = solution.configuration
    assert set(read["turns"].values()) == {-1, 0, 1}
    again = arm.ik(arm.fk(q), prefer=read)
    assert again.success
    assert again.configuration["turns"] == read["turns"]
    assert again.configuration["arm_angle"] == pytest.approx(read["arm_angle"], abs=1e-9)


def test_positions_and_pointing_goals() -> None:
    arm = kinseek.load("ur5e")
    T = arm.fk([0.3, -1.2, 1.4, -0.8, 0.7, 0.5])
    for goal in (Goal.position(T[:3, 3]), Goal.pointing(T[:3, 3], T[:3, 2])):
        for elbow in NAMES["elbow"]:
            solution = arm.ik(goal, prefer={"elbow": elbow, "shoulder": "front"})
            assert solution.success
            assert solution.configuration["elbow"] == elbow
    panda = kinseek.load("panda")
    T = panda.fk([0.2, 0.3, 0.1, -1.8, 0.2, 2.0, 0.4])
    for goal in (Goal.position(T[:3, 3]), Goal.pointing(T[:3, 3], T[:3, 2])):
        for angle in (-1.0, 1.0):
            solution = panda.ik(goal, prefer={"arm_angle": angle})
            assert solution.success
            assert solution.configuration["arm_angle"] == pytest.approx(angle, abs=1e-9)


def test_scenes() -> None:
    arm = kinseek.load("ur5e")
    q = np.array([0.3, -1.2, 1.4, -0.8, 0.7, 0.5])
    scene = kinseek.Scene.of(arm, capsules=0.02)
    for elbow in NAMES["elbow"]:
        solution = arm.ik(arm.fk(q), prefer={"elbow": elbow, "shoulder": "front"}, scene=scene)
        assert solution.success
        assert solution.configuration["elbow"] == elbow


def shoulder_elbow_wrist(arm: kinseek.Arm, q: Array) -> tuple[Array, Array]:
    """Elbow and wrist, (k, 3) each, seen from the shoulder [m]."""
    axes = axes_of(arm.chain.arrays)
    assert axes is not None
    shoulder, elbow, wrist = (foot(axes, on, near) for on, near in ((0, 1), (3, 2), (6, 5)))
    assert shoulder is not None
    assert elbow is not None
    assert wrist is not None
    motions = displaced(axes, q)
    return motions[2].moved(elbow) - shoulder, motions[-1].moved(wrist) - shoulder


def arm_angle_in(arm: kinseek.Arm) -> ArmAngle:
    found = arm_angle_of(arm.chain.arrays)
    assert found is not None
    return found


@pytest.mark.parametrize("name", SEVEN)
def test_the_arm_angle_is_that_of_elias_and_wen(name: str) -> None:
    """Their formula with normals: the plane of shoulder, elbow and wrist, and the plane of reference."""
    arm = kinseek.load(name)
    found, q = arm_angle_in(arm), arm.sample(50, seed=1)
    E, W = shoulder_elbow_wrist(arm, q)
    # Both are fixed: the shoulder in the base, the wrist in the hand.
    T = arm.fk(q)
    at = np.einsum("kji,kj->ki", T[:, :3, :3], W + found.shoulder - T[:, :3, 3])
    np.testing.assert_allclose(at, at[:1] + np.zeros_like(at), atol=1e-12)
    for e, w, angle in zip(E, W, arm.ik(T, near=q).configuration["arm_angle"], strict=True):
        unit = w / np.linalg.norm(w)
        normal, reference = np.cross(w, e), np.cross(unit - BEHIND, REFERENCE)
        normal, reference = normal / np.linalg.norm(normal), reference / np.linalg.norm(reference)
        expected = math.atan2(normal @ np.cross(unit, reference), normal @ reference)
        assert abs(math.remainder(angle - expected, math.tau)) < 1e-6
    step = 1e-6
    for i in range(7):
        difference = found.angles(q + step * np.eye(7)[i]) - found.angles(q - step * np.eye(7)[i])
        np.testing.assert_allclose(
            found.with_gradients(q)[1][:, i], difference / (2 * step), rtol=1e-5, atol=1e-6
        )


@pytest.mark.parametrize("name", SEVEN)
def test_the_arm_angle_of_a_stretched_self_motion_is_its_turn(name: str) -> None:
    """Where the hand is at rest, the elbow turns about a fixed line: by as much as the arm angle says."""
    arm = kinseek.load(name)
    T = arm.fk(arm.lower * 0.4 + arm.upper * 0.6)
    sample = arm.branches(T, count=30)
    assert isinstance(sample, Branches)
    E, W = shoulder_elbow_wrist(arm, sample.q)
    w = W[0] / np.linalg.norm(W[0])
    flat = E - (E @ w)[:, None] * w
    turned = np.arctan2(np.cross(flat[0], flat) @ w, flat @ flat[0])
    angles = sample.configuration["arm_angle"]
    error = np.remainder(angles - angles[0] - turned + math.pi, math.tau) - math.pi
    # Solutions are within the tolerances of the pose.
    np.testing.assert_allclose(error, 0.0, atol=3e-5)


@pytest.mark.slow
@pytest.mark.parametrize("name", SEVEN)
def test_a_commanded_arm_angle(name: str) -> None:
    arm = kinseek.load(name)
    q, others = arm.sample(12, seed=5), arm.sample(12, seed=6)
    met = 0
    for one, other in zip(q, others, strict=True):
        T = arm.fk(one)
        solution = arm.ik(T, near=one)
        angle = solution.configuration["arm_angle"]
        # Read it, command it: the same solution.
        same = arm.ik(T, near=one, prefer={"arm_angle": angle})
        assert same.success
        np.testing.assert_allclose(same.q, solution.q, atol=1e-9)
        # It is found from elsewhere, and without joint values to start from.
        for near in (other, None):
            found = arm.ik(T, near=near, prefer={"arm_angle": angle})
            assert found.success
            assert abs(math.remainder(found.configuration["arm_angle"] - angle, math.tau)) < 1e-9
        # A small turn of the elbow from there.
        turned = arm.ik(T, near=one, prefer={"arm_angle": angle + 0.05})
        assert turned.success
        error = abs(math.remainder(turned.configuration["arm_angle"] - angle - 0.05, math.tau))
        met += error < 1e-9
        if error < 1e-9 and np.abs(turned.q - one).max() < 0.5:
            assert (turned.q >= arm.lower).all()
            assert (turned.q <= arm.upper).all()
    assert met >= 9


def test_an_arm_angle_out_of_reach_gives_the_nearest() -> None:
    arm = kinseek.load("panda")
    T = arm.fk([0.2, 0.3, 0.1, -1.8, 0.2, 2.0, 0.4])
    sample = arm.branches(T, count=500)
    assert isinstance(sample, Branches)
    angles = np.sort(np.asarray(sample.configuration["arm_angle"]))
    gaps = np.diff(np.concatenate([angles, angles[:1] + math.tau]))
    widest = int(gaps.argmax())
    assert gaps[widest] > 0.5
    wanted = angles[widest] + 0.3 * gaps[widest]
    solution = arm.ik(T, prefer={"arm_angle": wanted})
    assert solution.success
    error = abs(math.remainder(solution.configuration["arm_angle"] - wanted, math.tau))
    assert 0.0 < error < 0.3 * gaps[widest] + 1e-3


@pytest.mark.parametrize("name", SEVEN)
def test_an_arm_angle_of_0_is_an_elbow_that_is_up(name: str) -> None:
    """If the arm reaches along x; the wrist is turned to the height of the shoulder by joint 2."""
    arm = kinseek.load(name)
    q = np.tile([0.0, 0.0, 0.0, -1.5, 0.0, 0.5, 0.0], (721, 1))
    q[:, 1] = np.linspace(-np.pi, np.pi, 721)
    elbow, wrist = shoulder_elbow_wrist(arm, q)
    level = (np.abs(wrist[:, 2]) < 5e-3) & (wrist[:, 0] > 0.1)
    assert level.any()
    angles, up = arm_angle_in(arm).angles(q[level]), elbow[level, 2] > 0.0
    for angle, is_up in zip(angles, up, strict=True):
        assert abs(math.remainder(float(angle) - (0.0 if is_up else math.pi), math.tau)) < 0.1


def test_valid_decides_before_the_arm_angle() -> None:
    arm = kinseek.load("panda")
    T = arm.fk([0.2, 0.3, 0.1, -1.8, 0.2, 2.0, 0.4])
    found = arm_angle_in(arm)
    wanted = float(found.angles(np.array([[0.2, 0.3, 0.1, -1.8, 0.2, 2.0, 0.4]]))[0])

    def elsewhere(q: Array) -> bool:
        return abs(math.remainder(float(found.angles(q[None])[0]) - wanted, math.tau)) > 0.2

    solution = arm.ik(T, prefer={"arm_angle": wanted}, valid=elsewhere)
    assert solution.success
    error = abs(math.remainder(solution.configuration["arm_angle"] - wanted, math.tau))
    assert 0.2 < error < 0.3
    assert solution.rejected > 0
    never = arm.ik(T, prefer={"arm_angle": wanted}, valid=lambda q: False)
    assert never.status is kinseek.Status.REJECTED
    assert never.configuration["arm_angle"] == pytest.approx(wanted, abs=1e-9)


def test_an_arm_angle_in_a_scene() -> None:
    arm = kinseek.load("panda")
    T = arm.fk([0.2, 0.3, 0.1, -1.8, 0.2, 2.0, 0.4])
    free = arm.ik(T, prefer={"arm_angle": -0.2})
    scene = kinseek.Scene.of(arm, capsules=0.02)
    same = arm.ik(T, prefer={"arm_angle": -0.2}, scene=scene)
    assert same.configuration["arm_angle"] == pytest.approx(free.configuration["arm_angle"], abs=1e-9)
    elbow = shoulder_elbow_wrist(arm, free.q[None])[0][0] + [0.0, 0.0, 0.333]
    scene.add_sphere("in the way of the elbow", 0.03, kinseek.pose(elbow))
    other = arm.ik(T, prefer={"arm_angle": -0.2}, scene=scene)
    assert other.success
    assert bool(scene.free(other.q))


def test_where_the_arm_angle_is_undefined() -> None:
    arm = kinseek.load("iiwa14")
    stretched = arm.ik(arm.fk(np.zeros(7)), near=np.zeros(7))
    assert stretched.success
    assert math.isnan(stretched.configuration["arm_angle"])
    arm = kinseek.load("iiwa14_srs")
    # The wrist below the shoulder: with the elbow bent, joint 2 turns the arm until it is.
    q = np.array([0.0, 0.0, 0.0, 1.2, 0.0, 0.4, 0.0])
    _, (w,) = shoulder_elbow_wrist(arm, q[None])
    q[1] = math.pi - math.atan2(w[0], w[2])
    assert np.isnan(arm_angle_in(arm).angles(q[None])).all()


def test_errors() -> None:
    ur, panda = kinseek.load("ur5e"), kinseek.load("panda")
    T = ur.fk([0.3, -1.2, 1.4, -0.8, 0.7, 0.5])
    cases: list[tuple[kinseek.Arm, Any, str]] = [
        (
            ur,
            {"elbo": "up"},
            r"unknown posture of 'ur5e' 'elbo'; did you mean 'elbow'\? Valid: elbow, shoulder, turns, wrist",
        ),
        (ur, {"elbow": "top"}, r"unknown value of 'elbow' 'top'.* Valid: down, up"),
        (ur, {"elbow": None}, r"unknown value of 'elbow' 'None'"),
        (ur, {"elbow": ["up"]}, r"unknown value of 'elbow'"),
        (ur, {"elbow": np.array(["up", "down"])}, r"unknown value of 'elbow'"),
        (ur, {}, r"requests no posture; valid names: shoulder, elbow, wrist, turns"),
        (ur, {"arm_angle": 0.5}, r"unknown posture of 'ur5e' 'arm_angle'"),
        (ur, {"turns": 1}, r"must map joints to whole numbers, such as .*, got 1"),
        (ur, {"turns": {"wrist": 1}}, r"unknown joint that can turn more than once 'wrist'"),
        (ur, {"turns": {"wrist_3_joint": 0.5}}, r"must be a whole number, got 0.5"),
        (panda, {"elbow": "up"}, r"unknown posture of 'panda' 'elbow'.* Valid: arm_angle"),
        (panda, {"arm_angle": "0.5"}, r"must be one finite angle \[rad\], got '0.5'"),
        (panda, {"arm_angle": math.nan}, r"must be one finite angle"),
    ]
    for arm, prefer, message in cases:
        with pytest.raises(kinseek.InvalidProblem, match=message):
            arm.ik(T, prefer=prefer)
        with pytest.raises(kinseek.InvalidProblem, match=message):
            arm.ik(T, prefer=prefer, scene=kinseek.Scene.of(arm, capsules=0.02))
    near = np.zeros(6)
    with pytest.raises(kinseek.InvalidProblem, match="near and prefer cannot be combined"):
        ur.ik(T, near=near, prefer="limits")
    with pytest.raises(kinseek.InvalidProblem, match="near and cost cannot be combined"):
        ur.ik(T, near=near, cost=lambda rows: rows[:, 0], prefer={"elbow": "up"})
    for name, kind in (("scara4", "prismatic"), ("jaco2_6", "continuous"), ("ur10e_rail", "prismatic")):
        arm = kinseek.load(name)
        with pytest.raises(kinseek.InvalidProblem, match=rf"postures of '{name}' have no names.*{kind}"):
            arm.ik(T, prefer={"elbow": "up"})
        with pytest.raises(kinseek.InvalidUse, match=rf"postures of '{name}' have no names"):
            _ = arm.ik(arm.fk(arm.sample(1)[0])).configuration
    box = kinseek.Arm.from_fk(ur.fk, ur.lower, ur.upper, kinds="revolute")
    with pytest.raises(kinseek.InvalidUse, match="black-box"):
        _ = box.ik(T, near=near).configuration


def test_all_eight() -> None:
    arm = kinseek.load("ur5e")
    words = words_of(branches_of(arm, np.array([0.3, -1.0, 1.2, 0.4, 0.8, 0.2])).configuration)
    assert set(words) == set(itertools.product(*NAMES.values()))


@pytest.mark.parametrize(
    "ranges", [{"free": "rz", "cone": 0.2}, {"box": {"rx": (-0.2, 0.2), "x": (-0.1, 0.1)}}]
)
def test_goals_with_ranges_take_postures_and_arm_angles(ranges: dict[str, Any]) -> None:
    T = kinseek.pose([0.4, 0.2, 0.4], rpy=[np.pi, 0.0, 0.3])
    goal = kinseek.Goal.pose(T, **ranges)
    wanted: tuple[tuple[str, dict[str, Any]], ...] = (
        ("panda", {"arm_angle": 0.3}),
        ("ur5e", {"elbow": "down"}),
    )
    for name, posture in wanted:
        arm = kinseek.load(name)
        solution = arm.ik(goal, prefer=posture).require()
        assert goal.met(goal.measure(arm.chain.arrays, solution.q[None]))[0]
        for key, value in posture.items():
            found = solution.configuration[key]
            assert found == value if isinstance(value, str) else abs(found - value) < 1e-9
