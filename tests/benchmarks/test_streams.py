"""The judge of trackers finds what is planted, and streams are what they are said to be."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.moving import (
    PERIOD,
    STREAMS,
    Limits,
    holds,
    lag,
    overshoot,
    periods,
    rests,
    reversals,
    stream,
    violations,
)
from benchmarks.targets import plain_fk, pose_errors

Array = NDArray[np.float64]

LIMITS, KINDS = Limits(1.5, 20.0, 1000.0), ("velocity", "acceleration", "jerk")


def moved(count: int, seconds: float, by: float) -> Array:
    """A joint that goes some way with jerks as small as can be, and rests."""
    s = np.clip(np.arange(1, count + 1) * PERIOD / seconds, 0, 1)
    return np.asarray(by * s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3))


def middle(arm: kinseek.Arm) -> Array:
    """The middle of the ranges, (n,)."""
    return np.asarray((arm.lower + arm.upper) / 2)


def still(arm: kinseek.Arm, count: int = 1000) -> Array:
    """Joint values that keep the limits, (count, n): the third joint moves, all others rest."""
    return np.asarray(middle(arm) + moved(count, 1.0, 0.3)[:, None] * (np.arange(arm.dof) == 2))


def test_a_motion_within_the_limits_violates_none() -> None:
    arm = kinseek.load("panda")
    found = violations(arm, still(arm), middle(arm), LIMITS)
    assert found.steps == dict.fromkeys(("position", "velocity", "acceleration", "jerk"), 0)
    assert found.first == {}
    assert 0.3 < found.share["velocity"] < 1.0


@pytest.mark.parametrize(
    ("by", "kinds"),
    [(0.99e-6, ()), (1.01e-6, ("jerk",)), (1e-4, ("acceleration", "jerk")), (5e-3, KINDS)],
)
def test_one_step_too_far_is_counted(by: float, kinds: tuple[str, ...]) -> None:
    arm = kinseek.load("panda")
    q = np.tile(middle(arm), (100, 1))
    q[50:, 4] += by
    # The jerk of a step is first as large as the step, then minus two and plus one times that.
    found = violations(arm, q, q[0], Limits(1.5, 20.0, 2 * 1e-6 / PERIOD**3))
    assert {kind for kind, number in found.steps.items() if number} == set(kinds)
    assert set(found.first) == set(kinds)
    assert all(found.first[kind][0] in (50, 51) for kind in kinds)
    assert all(found.first[kind][1] == 4 for kind in kinds)


def test_rounding_is_no_violation_and_a_joint_outside_is_one() -> None:
    arm = kinseek.load("panda")
    q = np.tile(middle(arm), (100, 1))
    q[::2, 1] = np.nextafter(q[0, 1] + 1, 9)
    q[1::2, 1] = q[0, 1] - np.spacing(q[0, 1])
    assert not any(violations(arm, q, q[0], Limits(1.5, 1e-9, 1e-9)).steps.values())
    q[7, 5] = np.nextafter(arm.upper[5], 9)
    assert violations(arm, q, q[0], Limits(np.inf)).steps["position"] == 1


def test_rest_reversals_and_lag() -> None:
    arm = kinseek.load("panda")
    q = still(arm, periods(4.0))
    T = plain_fk(arm.chain, np.repeat(q[-1:], len(q), axis=0))
    (rest,) = rests(arm.chain, q, T)
    assert rest.seconds == pytest.approx(1.0, abs=0.1)
    assert rest.reversals == 0
    assert rest.reached
    assert overshoot(q, T) == 0
    q[700, 2] += 0.5
    assert overshoot(q, T) == pytest.approx(q[700, 2] - q[-1, 2])
    q[700, 2] -= 0.5
    q[-100::2, 3] += 1e-7
    (rest,) = rests(arm.chain, q, T)
    assert rest.seconds == np.inf
    assert 98 <= rest.reversals <= 100
    assert reversals(np.array([1.0, -1.0, 1e-9, -1.0, 1.0])) == 2
    q = still(arm)
    behind = lag(arm.chain, q[:-20], plain_fk(arm.chain, q[20:]))
    assert behind.behind == pytest.approx(20 * PERIOD)
    assert behind.shape < 1e-12 < behind.mean < behind.largest


@pytest.mark.slow
@pytest.mark.parametrize("kind", STREAMS)
@pytest.mark.parametrize("name", ["ur5e", "gen3", "so101"])
def test_a_stream_is_the_same_again_and_begins_where_it_says(name: str, kind: str) -> None:
    arm = kinseek.load(name)
    made, again = stream(arm, kind, 1), stream(arm, kind, 1)
    np.testing.assert_array_equal(made.T, again.T)
    np.testing.assert_array_equal(made.q0, again.q0)
    assert (stream(arm, kind, 2).T[:1] != made.T).any()
    assert ((made.q0 >= arm.lower) & (made.q0 <= arm.upper)).all()
    R = made.T[:, :3, :3]
    np.testing.assert_allclose(R @ np.swapaxes(R, 1, 2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)
    away, angle = pose_errors(plain_fk(arm.chain, made.q0[None]), made.T[:1])
    assert kind == "step" or (away[0] < 1e-2 and angle[0] < 5e-2)
    assert len(list(holds(made.T))) >= 1
