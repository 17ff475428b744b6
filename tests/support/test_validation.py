"""What NumPy would drop (an imaginary part, a mask) or take for numbers (text, bools) is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.support.validation import largest_of

ARM = kinseek.load("planar2")
T = ARM.fk([0.3, 0.4])
HELD: list[Callable[[Any], Any]] = [
    ARM.ik,
    ARM.branches,
    kinseek.Goal.pose,
    lambda T: ARM.ik(T[None], bad="skip"),
    lambda T: kinseek.pose(T[:3, 3]),
    lambda T: kinseek.pose([0, 0, 0], rotation=T[:3, :3]),
    lambda T: kinseek.Goal.position(T[:3, 3]),
    lambda T: ARM.fk(T[0, :2]),
    lambda T: ARM.ik(kinseek.pose([0.5, 0.1, 0.0]), near=T[0, :2]),
]


@pytest.mark.parametrize("sign", [1, -1])
def test_a_whole_number_beyond_all_floats_is_refused(sign: int) -> None:
    trajectory = ARM.move([0.0, 0.0], [0.1, 0.1], velocity=1.0, acceleration=1.0)
    for take in (trajectory.q, trajectory.sample, trajectory.to_ros):
        with pytest.raises(kinseek.InvalidProblem):
            take(sign * 10**400)


@pytest.mark.parametrize("take", HELD)
def test_an_imaginary_part_is_refused(take: Callable[[Any], Any]) -> None:
    with pytest.raises(kinseek.KinseekError, match=r"\d+ of \d+ numbers have an imaginary part"):
        take(T + 0.1j)


@pytest.mark.parametrize("take", HELD)
def test_masked_numbers_are_refused(take: Callable[[Any], Any]) -> None:
    with pytest.raises(kinseek.KinseekError, match=r"\d+ of \d+ numbers are masked"):
        take(np.ma.masked_array(T, mask=np.ones((4, 4), dtype=bool)))


@pytest.mark.parametrize("take", [*HELD, lambda T: kinseek.Arm.from_dh(T[:1], [-1.0], [1.0])])
@pytest.mark.parametrize(
    ("given", "what"), [(T.astype(str), "text"), (T > 0, "bools"), (T.astype("m8[s]"), "durations")]
)
def test_text_and_bools_are_no_numbers(take: Callable[[Any], Any], given: Any, what: str) -> None:
    with pytest.raises(kinseek.KinseekError, match=f"got {what}, not numbers"):
        take(given)


@pytest.mark.parametrize("q", [["0.5", "0.1"], ["0.5", 0.1], [True, False]])
def test_text_and_bools_in_a_list_are_no_numbers(q: Any) -> None:
    for take in (ARM.fk, lambda q: ARM.ik(T, near=q), ARM.track, lambda q: ARM.move(q, [0.0, 0.0])):
        with pytest.raises(kinseek.KinseekError, match=r"got (text|bools), not numbers"):
            take(q)


def test_real_numbers_in_other_arrays_are_taken() -> None:
    q = ARM.ik(T).q
    assert (ARM.ik(T.astype(complex)).q == q).all()
    assert (ARM.ik(np.ma.masked_array(T, mask=np.zeros((4, 4), dtype=bool))).q == q).all()
    assert (ARM.fk(q.astype(complex)) == ARM.fk(q)).all()


@pytest.mark.parametrize("shape", [(), (0,), (0, 3), (5,), (2, 4, 3), (1, 700_000, 2), (1_500_000,)])
def test_the_largest_number_is_that_of_all_chunks(shape: tuple[int, ...]) -> None:
    numbers = np.random.default_rng(0).uniform(-1, 1, shape)
    for some in (numbers, np.asfortranarray(numbers), np.broadcast_to(numbers, (2, *shape))):
        assert largest_of(some) == np.abs(some).max(initial=0.0)
