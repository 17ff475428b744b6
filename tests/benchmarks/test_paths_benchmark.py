"""The fewest breaks of a path, of all solutions at values of the last joint."""

from __future__ import annotations

import numpy as np

import kinseek
from benchmarks.paths.peers import fewest_breaks, solutions_over


def test_solutions_over_the_last_joint_are_all_of_them() -> None:
    arm = kinseek.load("panda")
    T = arm.fk(arm.sample(3, seed=5))
    for pose, q in zip(T, solutions_over(arm, T, 40), strict=True):
        assert len(q)
        assert np.abs(arm.fk(q) - pose).max() < 1e-9
        value = q[0, 6]
        locked = arm.with_locked({arm.joint_names[-1]: float(value)})
        assert len(locked.branches(pose)) == (q[:, 6] == value).sum()


def test_the_fewest_breaks_are_where_no_solution_leads_on() -> None:
    one, other = np.array([[0.0], [1.0]]), np.array([[1.05]])
    layers = [one, one + 0.1, other, one[:1], one[:1] + 0.05, other]
    # From 1.0 over 1.1 to 1.05; the next solution is far, and so is the last one.
    assert fewest_breaks(layers, np.array([0.2])) == [3, 5]
    assert fewest_breaks(layers, np.array([2.0])) == []
    assert fewest_breaks(layers[::-1], np.array([0.2])) == [1, 3]
