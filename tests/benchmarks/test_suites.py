"""Other projects' suites as benchmarks: their files are read as they mean them, and what is wrong is counted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import kinseek
from benchmarks.suites import Goal, answered, eaik, row, stereo_sew

WRIST = """
bool some_test()
{
	Eigen::Matrix<double, 3, 6> H;
	H << ez, -ey, -ey, ez, -ey, ez;
	Eigen::Matrix<double, 3, 7> P;
	P << (0.5 + 0.1) * ez, zv, 0.4*ex - 0.15 * ey, 0.4 * ez, zv, zv, 0.05*ez;
	return evaluate_test<EAIK::Robot>("six joints", robot, ee_poses);
}

bool locked_test()
{
	H << ez, ey, ez, -ey, ez, ey, ez;
	P << 0.3*ez, zv, 0.2*ez, 0.2*ez, 0.4*ez, zv, zv, 0.1*ez;
	double q3_angle = rand_angle();
	EAIK::Robot robot(H, P, Eigen::Matrix<double, 3, 3>::Identity(), {std::pair<int, double>(2, q3_angle)});
	return evaluate_test<EAIK::Robot>("seven joints", robot, ee_poses);
}
"""


@pytest.fixture
def goals(tmp_path: Path) -> list[Goal]:
    pytest.importorskip("pinocchio")
    file = tmp_path / "CPP" / "Tests" / "System_Tests" / "6R" / "IK_system_tests_6R.cpp"
    file.parent.mkdir(parents=True)
    file.write_text(WRIST, encoding="utf-8")
    return list(eaik(tmp_path, 3))


def test_arms_are_those_of_the_file(goals: list[Goal]) -> None:
    assert [goal.model.name for goal in goals] == ["six joints"] * 3 + ["seven joints"] * 3
    np.testing.assert_allclose(goals[0].model.arm.fk(np.zeros(6))[:3, 3], [0.4, -0.15, 1.05], atol=1e-12)
    q = [np.pi / 2, 0.0, 0.0, 0.0, 0.0, 0.0]
    np.testing.assert_allclose(goals[0].model.arm.fk(q)[:3, 3], [0.15, 0.4, 1.05], atol=1e-12)
    assert {goal.fixed for goal in goals[3:]} == {(2,)}
    assert np.ptp([goal.known[0, 2] for goal in goals[3:]]) == 0.0


def test_what_is_wrong_is_counted(goals: list[Goal]) -> None:
    locked: dict[tuple[float, ...], kinseek.Arm] = {}
    right = answered(goals[0], locked)
    assert right.exact
    assert right.found == right.listed >= 1
    assert right.wrong == right.sampled == 0
    planted = goals[0]._replace(known=goals[0].known + 0.1)
    missed = answered(planted, locked)
    assert missed.found == 0
    cells = row("six", [goals[0], planted], [right, missed])
    assert (cells[">exact"], cells[">found"]) == (2, right.found)
    far = goals[0].T.copy()
    far[:3, 3] += 5.0
    assert not answered(goals[0]._replace(T=far), locked).exact


def test_families_of_arms_have_parallel_and_intersecting_axes(tmp_path: Path) -> None:
    pytest.importorskip("pinocchio")
    (tmp_path / "+SEW_IK_setups").mkdir()
    (tmp_path / "+SEW_IK_setups" / "IK_some.m").write_text(
        "P.kin.P = [rand_vec zv rand_vec rand_vec rand_vec rand_vec zv rand_vec];\n"
        "P.kin.H = rand_normal_vec(7);\nP.kin.H(:,4) = P.kin.H(:,3);\n% P.kin.H(:,5) = P.kin.H(:,3);\n",
        encoding="utf-8",
    )
    (goal,) = stereo_sew(tmp_path, 1)
    chain = goal.model.judge.arm
    np.testing.assert_allclose(chain.axes[2], chain.axes[3], atol=1e-12)
    assert np.abs(chain.axes[3] - chain.axes[4]).max() > 0.01
    np.testing.assert_allclose(chain.points[0], chain.points[1], atol=1e-12)
    assert answered(goal, {}).found == 1
