"""Two arms that move at the same time."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import InvalidProblem, InvalidScene, Scene
from kinseek.collision import Sphere
from kinseek.collision.together import speeds_of_both
from kinseek.timing.trajectory import Trajectory

PLANAR = kinseek.Arm.from_dh([[0.4, 0, 0, 0], [0.4, 0, 0, 0]], [-3, -3], [3, 3])
FACING = kinseek.pose([1.0, 0.1, 0.0], rpy=[0, 0, np.pi])
RADIUS = 0.04


def two(q: Any = (0.5, 0.5)) -> Scene:
    scene = Scene.of(PLANAR, capsules=RADIUS)
    scene.add_arm("other", Scene.of(PLANAR, capsules=RADIUS), q, FACING)
    return scene


def motion(q: Any, **speeds: float) -> Trajectory:
    rows = np.concatenate([np.linspace(a, b, 20)[:-1] for a, b in pairwise(q)] + [[q[-1]]])
    path = PLANAR.follow(PLANAR.fk(rows), start=rows[0])
    return path.require().timed(velocity=2.0, acceleration=5.0, **speeds)


def gap(q: np.ndarray, theirs: np.ndarray) -> float:
    """Distance of the capsules of two planar arms, by points along their middles [m]; it is not below the true one."""
    share, lines = np.linspace(0.0, 1.0, 60)[:, None], []
    for joints, base in ((q, np.eye(4)), (theirs, FACING)):
        turn = np.cumsum(joints)
        corners = np.cumsum([[0.0, 0.0], *(0.4 * np.column_stack([np.cos(turn), np.sin(turn)]))], axis=0)
        flat = np.concatenate([a + share * (b - a) for a, b in pairwise(corners)])
        lines.append(flat @ base[:2, :2].T + base[:2, 3])
    return float(np.linalg.norm(lines[0][:, None] - lines[1], axis=2).min()) - 2 * RADIUS


def gaps(one: Trajectory, other: Trajectory, times: np.ndarray, delay: float = 0.0) -> np.ndarray:
    mine = one.q(np.clip(times - delay, 0.0, one.duration))
    theirs = other.q(np.clip(times, 0.0, other.duration))
    return np.array([gap(*rows) for rows in zip(mine, theirs, strict=True)])


@pytest.mark.parametrize(
    "names", [("ur5e", "panda"), ("scara4", "cylindrical3"), ("cylindrical3", "planar2")]
)
def test_joined_arms_stand_where_each_stands_alone(names: tuple[str, str]) -> None:
    arm, other = (kinseek.load(name) for name in names)
    base = kinseek.pose([0.9, 0.3, 0.1], rpy=[0.3, -0.2, 2.5])
    scene, others = Scene.of(arm, capsules=0.05, padding=0.01), Scene.of(other, capsules=0.06)
    scene.attach("load", Sphere(0.1), to=arm.tip, pose=kinseek.pose([0.0, 0.05, 0.1]))
    others.attach("ball", Sphere(0.07), to=other.tip)
    scene.add_arm("other", others, other.sample(1)[0], base)
    mine = [body for body in scene._bodies.values() if body.is_link or body.frame.joints]
    speeds = speeds_of_both(scene._chain, mine, scene._others["other"], {})
    q, theirs = arm.sample(6, seed=1), other.sample(6, seed=2)
    owners = {(a.name, b) for a in mine for b in scene._others["other"].names}
    pairs = [n for n, names in enumerate(scene._made.owners) if names in owners]
    assert len(pairs) >= 2
    joined = [
        np.array([near.distance for near in speeds.engine.near(np.r_[rows])])
        for rows in zip(q, theirs, strict=True)
    ]
    for one, row, distances in zip(q, theirs, joined, strict=True):
        scene.move("other", row)
        engine = scene._engine
        with engine.lock:
            alone = np.array([near.distance for near in engine.near(one)])[pairs]
        assert all(np.abs(distances - distance).min() < 1e-9 for distance in alone)
        bounds = speeds.engine.bounds(np.r_[one, row][None])[0]
        assert (bounds <= distances + 1e-6).all()
    # No distance changes faster than the bounds say.
    for k in range(5):
        ends = np.r_[q[k], theirs[k]][None], np.r_[q[k + 1], theirs[k + 1]][None]
        assert (np.abs(joined[k + 1] - joined[k]) <= speeds.of(*ends)[0] + 1e-6).all()
        still = np.r_[q[k + 1], theirs[k]][None], np.r_[q[k + 1], theirs[k + 1]][None]
        assert (speeds.of(*still) <= speeds.of(*ends) + 1e-12).all()


@pytest.mark.slow
def test_no_contact_before_the_time_and_one_soon_after() -> None:
    scene, rng, finite = two(), np.random.default_rng(0), 0
    for _ in range(25):
        one, other = (motion(rng.uniform([-1.2, -2.0], [1.2, 2.0], (3, 2))) for _ in range(2))
        delay = float(rng.choice([0.0, 0.7]))
        until = scene.free_until(one, {"other": other}, delay=delay)
        last = max(one.duration + delay, other.duration)
        times = np.linspace(0.0, min(until, last), 150)
        assert (gaps(one, other, times, delay) > 0).all() or until == 0.0
        if 0.0 < until < np.inf:
            finite += 1
            assert until <= last
            assert gaps(one, other, np.linspace(until, min(until + 0.03, last), 60), delay).min() < 2e-3
        if until == 0.0:
            assert gaps(one, other, np.zeros(1), delay)[0] < 2e-3
        assert scene.free_until(one, {"other": other}, 0.05, delay) <= until
    assert finite > 5


def test_waiting_lets_the_other_arm_pass() -> None:
    scene = two()
    one, other = motion([[-1.2, 0.0], [0.9, 0.0]]), motion([[0.3, 0.0], [2.6, 0.0]])
    now = scene.free_until(one, {"other": other})
    assert now < other.duration
    later = next(
        d for d in np.arange(0.0, 5.0, 0.25) if scene.free_until(one, {"other": other}, delay=d) == np.inf
    )
    assert later > 0
    assert (gaps(one, other, np.linspace(0.0, 6.0, 500), later) > 0).all()
    scene.move("other", [0.0, 0.0])  # Where it stands in the scene plays no role.
    assert scene.free_until(one, {"other": other}) == now
    scene.allow("link2", "other/link2")
    for mine, theirs in (("link1", "other/link2"), ("link2", "other/link1"), ("link1", "other/link1")):
        scene.allow(mine, theirs)
    assert scene.free_until(one, {"other": other}) == np.inf


def test_a_motion_may_end_with_a_speed() -> None:
    scene, still = two(), motion([[0.9, 0.0], [0.9, 1e-4]])
    one = motion([[-1.2, 0.0], [-0.2, 0.0]], end_velocity=0.5)
    until = scene.free_until(one, {"other": still})
    times = np.linspace(0.0, min(until, one.duration + 1.0), 400)
    assert (gaps(one, still, times) > 0).all()


def test_motions_that_do_not_fit_are_rejected() -> None:
    scene, one = two(), motion([[0.0, 0.0], [0.5, 0.0]])
    panda = kinseek.load("panda")
    q = panda.sample(2, seed=0)
    foreign = panda.follow(panda.fk(np.linspace(q[0], q[0] + 0.1, 5)), start=q[0]).timed(acceleration=10.0)
    with pytest.raises(
        InvalidProblem, match=r"trajectory must be a trajectory, such as path\.timed\(\) returns, got list"
    ):
        scene.free_until([[0.0, 0.0]], {"other": one})  # type: ignore[arg-type]
    with pytest.raises(
        InvalidProblem, match=r"others\['other'\] is a motion of 'panda', expected one of 'dh arm'"
    ):
        scene.free_until(one, {"other": foreign})
    with pytest.raises(InvalidProblem, match="trajectory is a motion of 'panda'"):
        scene.free_until(foreign, {"other": one})
    with pytest.raises(InvalidScene, match="unknown arm of the scene 'othr'; did you mean 'other'"):
        scene.free_until(one, {"othr": one})
    wrong: tuple[Any, ...] = ({}, one, None)
    for others in wrong:
        with pytest.raises(
            InvalidScene, match="others must map names of arms of the scene to their trajectories"
        ):
            scene.free_until(one, others)
    with pytest.raises(InvalidProblem, match="delay"):
        scene.free_until(one, {"other": one}, delay=-1.0)
    with pytest.raises(InvalidScene, match="clearance"):
        scene.free_until(one, {"other": one}, clearance=-1.0)
