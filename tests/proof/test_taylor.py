"""The Taylor polynomials of a box against plain computations.

`test_bounds.py` finds bounds that lose a joint vector. It does not find bounds that are too wide, or a step that is not
the best one: these only cost boxes. The kernels run as plain Python here, which needs no build and takes seconds.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal, Problem
from kinseek.kernels.backend import PLAIN
from kinseek.kernels.proof import box, taylor
from kinseek.kernels.proof.box import BoxScratch, Form, ProofGoal
from kinseek.proof.reduce import error_question, start_boxes
from reference import fk

Array = NDArray[np.float64]

pytestmark = pytest.mark.skipif(not PLAIN, reason="NUMBA_DISABLE_JIT=1 runs it, in seconds")

ARMS = ("planar2", "scara4", "cylindrical3", "ur5e", "panda", "ur10e_rail")


class Setting(NamedTuple):
    form: Form
    goal: ProofGoal
    scratch: BoxScratch
    rng: np.random.Generator


@pytest.fixture(params=ARMS)
def setting(request: pytest.FixtureRequest) -> Setting:
    """A small box of an arm, with its axes and the goal placed."""
    rng, chain = np.random.default_rng(3), kinseek.load(request.param).chain
    q = rng.uniform(np.maximum(chain.lower, -2), np.minimum(chain.upper, 2))
    T = fk(chain, rng.uniform(np.maximum(chain.lower, -2), np.minimum(chain.upper, 2)))
    problem = Problem(chain, Goal.pose(T))
    form, goal, last = error_question(problem, q, 0.5)
    dof = start_boxes(chain, last.present).shape[1] // 2
    scratch = box.make_box_scratch(len(form.leader), dof)
    scratch.c[:], scratch.h[:] = q[:dof], rng.uniform(0.01, 0.3, dof)
    box.place(form, scratch)
    box.turn_goal(form, goal, scratch)
    box.widths(form, scratch)
    return Setting(form, goal, scratch, rng)


def parts(pose: Array, columns: int) -> Array:
    """Point and columns that count, (1 + columns, 3)."""
    return np.vstack([pose[:, 3], pose[:, :columns].T])


def error_from(setting: Setting, middle: int) -> Callable[[Array], Array]:
    """The error after a step of the variables: joints from `middle` on move the hand, the others the goal backwards."""
    form, scratch = setting.form, setting.scratch

    def moved(pose: Array, k: int, value: float) -> Array:
        axis, point = scratch.z[k], scratch.p[k]
        if form.prismatic[k]:
            return np.column_stack([pose[:, :3], pose[:, 3] + value * axis])
        turn = Rotation.from_rotvec(value * axis).as_matrix()
        return np.column_stack([turn @ pose[:, :3], point + turn @ (pose[:, 3] - point)])

    def error(step: Array) -> Array:
        values, hand, goal = form.multiplier * step[form.leader], scratch.T, scratch.goal
        for k in range(len(values) - 1, middle - 1, -1):
            hand = moved(hand, k, values[k])
        for k in range(middle):
            goal = moved(goal, k, -values[k])
        return parts(hand, form.columns) - parts(goal, form.columns)

    return error


def jacobian(setting: Setting, middle: int) -> Array:
    """Derivatives of the error by the variables, (dof, 1 + columns, 3), by central differences."""
    error, dof = error_from(setting, middle), len(setting.scratch.c)
    return np.array([(error(e) - error(-e)) / 2e-5 for e in 1e-5 * np.eye(dof)])


def middles(setting: Setting) -> range:
    return range(len(setting.form.leader))


def differentiated(setting: Setting, middle: int) -> Array:
    form, scratch = setting.form, setting.scratch
    taylor.differentiate(form, scratch, middle, form.columns)
    return jacobian(setting, middle)


def test_first_derivatives(setting: Setting) -> None:
    form, scratch = setting.form, setting.scratch
    for middle in middles(setting):
        J, rows = differentiated(setting, middle), np.zeros((len(scratch.c), 1 + form.columns, 3))
        for k, i in enumerate(form.leader):
            rows[i] += form.multiplier[k] * parts(scratch.J[k], form.columns)
            assert scratch.r[k] == pytest.approx(np.linalg.norm(scratch.J[k][:, 3]), abs=1e-12)
            assert scratch.s[k] == pytest.approx(np.linalg.norm(scratch.J[k][:, : form.columns]), abs=1e-12)
        np.testing.assert_allclose(rows, J, atol=1e-8)


def test_second_derivatives(setting: Setting) -> None:
    form, scratch, rng = setting.form, setting.scratch, setting.rng
    dof, e = len(scratch.c), 1e-4 * np.eye(len(scratch.c))
    for middle in middles(setting):
        J, error = differentiated(setting, middle), error_from(setting, middle)
        scratch.y[:] = rng.normal(size=(3, 4))
        y = parts(scratch.y, form.columns)
        taylor.derivatives(form, scratch, middle, form.columns)
        np.testing.assert_allclose(scratch.g, (J * y).sum(axis=(1, 2)), atol=1e-7)
        for i in range(dof):
            for j in range(dof):
                four = (
                    error(e[i] + e[j]) - error(e[i] - e[j]) - error(e[j] - e[i]) + error(-e[i] - e[j])
                ) / 4e-8
                assert scratch.H[i, j] == pytest.approx((y * four).sum(), abs=1e-5)


def remainders(setting: Setting, radii: Array, middle: int) -> tuple[float, ...]:
    """The formula of `kernels.proof.bounds`, with ``S_k³ - S_{k-1}³``, from `middle` to either end."""
    form, scratch, total = setting.form, setting.scratch, np.zeros(4)
    for half in (range(middle, len(form.leader)), range(middle - 1, -1, -1)):
        S = 0.0
        for k in half:
            h, r, s = scratch.half[k], radii[k], scratch.s[k]
            if form.prismatic[k]:
                total += [h * S, 0.0, h * S**2 / 2, 0.0]
                continue
            two, three = ((S + h) ** 2 - S**2) / 2, ((S + h) ** 3 - S**3) / 6
            total += [two * r, two * s, three * r, three * s]
            S += h
    return tuple(total)


def test_remainders(setting: Setting) -> None:
    form, scratch = setting.form, setting.scratch
    for middle in middles(setting):
        differentiated(setting, middle)
        rest = taylor.rests(form, scratch, scratch.r, middle)
        assert tuple(rest) == pytest.approx(remainders(setting, scratch.r, middle), rel=1e-12)
        taylor.radii_behind(form, scratch, middle, 0.2)
        for k in middles(setting):
            seen = scratch.goal if k < middle else scratch.T
            lever = np.cross(scratch.z[k], seen[:, 3] - 0.2 * seen[:, 0] - scratch.p[k])
            assert scratch.back[k] == pytest.approx(
                1.0 if form.prismatic[k] else np.linalg.norm(lever), abs=1e-12
            )


def test_halfway_has_the_smallest_remainder(setting: Setting) -> None:
    form, scratch, goal = setting.form, setting.scratch, setting.goal
    counts, rests = (goal.length if form.columns else 0.0), []
    for middle in middles(setting):
        differentiated(setting, middle)
        seen = [scratch.goal if k < middle else scratch.T for k in middles(setting)]
        radii = np.array(
            [
                np.linalg.norm(np.cross(scratch.z[k], seen[k][:, 3] - scratch.p[k])) + counts
                for k in middles(setting)
            ]
        )
        radii[form.prismatic] = 0.0
        slides = sum(remainders(setting, np.zeros_like(radii), middle)[2:3])
        rests.append(remainders(setting, radii, middle)[2] - slides)
    chosen = taylor.halfway(form, goal, scratch)
    assert rests[chosen] == pytest.approx(min(rests), rel=1e-12)


def test_weighted_least_squares(setting: Setting) -> None:
    form, scratch, rng = setting.form, setting.scratch, setting.rng
    weight_p, weight_c, dof = 2.5, 0.7, len(scratch.c)
    for middle in middles(setting):
        J = differentiated(setting, middle).reshape(dof, -1)
        scratch.D[:] = rng.uniform(0.1, 1, dof)
        W = np.repeat([weight_p, *[weight_c] * form.columns], 3)
        f = error_from(setting, middle)(np.zeros(dof)).ravel()
        taylor.shrink_miss(form, scratch, weight_p, weight_c, form.columns)
        best = -np.linalg.solve((J * W) @ J.T + np.diag(scratch.D), J @ (W * f))
        np.testing.assert_allclose(scratch.delta, best, atol=1e-6)
        taylor.step_miss(form, scratch, form.columns)
        np.testing.assert_allclose(parts(scratch.y, form.columns).ravel(), f + best @ J, atol=1e-6)
        point, turned = taylor.miss(scratch, form.columns)
        assert point == pytest.approx(f[:3] @ f[:3])
        assert turned == pytest.approx(f[3:] @ f[3:])
        squares = taylor.squares_of(scratch.y, form.columns)
        y = parts(scratch.y, form.columns).ravel()
        assert squares == pytest.approx((y[:3] @ y[:3], y[3:] @ y[3:]))
