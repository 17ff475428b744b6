"""Exact coordinate descent for black-box kinematics, if its premise holds; this is tested first by evaluations.

Along one joint of a serial arm the squared chordal error is exactly a sinusoid or a parabola (see `kernels.grid.sinusoid`).
For black-box kinematics this is not known. So the function is evaluated at more poses along each joint than the fit needs,
at several places.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidSolver
from kinseek.kernels.arm.vectors import Vector
from kinseek.kernels.grid.sinusoid import Motion, minimise_pair, minimiser
from kinseek.problem import Problem
from kinseek.robots.blackbox import NUMBER, PRISMATIC
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.base import Found
from kinseek.solvers.recording import Recorder
from kinseek.solvers.traits import listed
from kinseek.support.caching import WeakCache
from kinseek.support.deadline import Deadline
from kinseek.support.turns import TURN

from .evaluator import Evaluator, features
from .samples import sample_joints

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Errors = Callable[[Array], Array]

PROBES, PLACES = 7, 3
"""Poses along a joint for testing its form, and places where it is tested; the fit has three coefficients."""
FITS = 1e-8
"""Largest accepted misfit, relative to the joint's effect: rounding leaves 1e-12, single precision fails."""

_forms: WeakCache[Mechanism, None, Flags] = WeakCache()


def answer(
    box: Mechanism,
    problem: Problem,
    deadline: Deadline,
    most_sweeps: int,
    pairs: bool,
    stall: float,
    recorder: Recorder | None = None,
) -> Found:
    """Descend from `problem.start`.

    Raises:
        InvalidSolver: Along some joint the error is neither a sinusoid nor a parabola; the message names the joint.
    """
    evaluator = Evaluator(box, problem, deadline)
    form = _forms.of(box).get(None, lambda: turning(box))
    goal = problem.goal
    weights = np.full(len(evaluator.target), goal.position_weight**2)
    # As in the compiled search: (K_P |Δp|)² + (K_A Δφ)² near the goal.
    weights[3:] = goal.orientation_weight**2 / 2

    def errors_at(rows: Array) -> Array:
        value = (evaluator.differences(rows) ** 2) @ weights
        return np.asarray(np.where(np.isnan(value), np.inf, value))

    q = problem.start.copy()
    if evaluator.left < 1:
        return Found(q, evaluator.spent, out_of_time=evaluator.out_of_time)
    away = evaluator.differences(q[None])
    error = float(((away**2) @ weights)[0])
    plan: list[tuple[int, ...]] = [(i,) for i in range(box.dof)]
    if pairs:
        plan += [(i, j) for i in range(box.dof - 1) for j in range(i + 1, box.dof)]
    if recorder:
        recorder.add("start", q, evaluator.spent, memory=q.nbytes)
    for sweep in range(most_sweeps):
        if evaluator.within(away)[0]:
            break
        before = error
        for joints in plan:
            if 3 ** len(joints) + 1 > evaluator.left:
                return Found(q, evaluator.spent, out_of_time=evaluator.out_of_time)
            trial = (
                line(box, form, joints[0], q, errors_at)
                if len(joints) == 1
                else plane(box, form, joints, q, errors_at)
            )
            value = float(errors_at(trial[None])[0])
            if value < error:
                q, error = trial, value
        if evaluator.left < 1:
            break
        away = evaluator.differences(q[None])
        if recorder:
            recorder.add(f"sweep {sweep + 1}", q, evaluator.spent, memory=q.nbytes)
        if before - error <= stall * before:
            break
    return Found(q, evaluator.spent, out_of_time=evaluator.out_of_time)


def line(box: Mechanism, form: Flags, i: int, q: Array, errors_at: Errors) -> Array:
    """Return joint values with joint i at the exact minimiser, (n,)."""
    values = places(box, form, i)
    rows = np.repeat(q[None], 3, axis=0)
    rows[:, i] = values
    fit = Vector(*np.linalg.solve(basis(values - q[i], form[i]), errors_at(rows)).tolist())
    moved = q.copy()
    moved[i] += minimiser(fit, motion_of(box, form, i, q))
    return np.clip(moved, box.lower, box.upper)


def plane(box: Mechanism, form: Flags, joints: tuple[int, ...], q: Array, errors_at: Errors) -> Array:
    """Return joint values with two joints at the minimiser of the bilinear form of nine poses, (n,)."""
    i, j = joints
    first, second = places(box, form, i), places(box, form, j)
    rows = np.repeat(q[None], 9, axis=0)
    rows[:, i], rows[:, j] = np.repeat(first, 3), np.tile(second, 3)
    F = errors_at(rows).reshape(3, 3)
    M = np.linalg.solve(basis(first - q[i], form[i]), F)
    M = np.linalg.solve(basis(second - q[j], form[j]), M.T).T
    joints_free = motion_of(box, form, i, q), motion_of(box, form, j, q)
    moved = q.copy()
    moved[[i, j]] += minimise_pair(np.ascontiguousarray(M), *joints_free)
    return np.clip(moved, box.lower, box.upper)


def motion_of(box: Mechanism, form: Flags, i: int, q: Array) -> Motion:
    """Return the motion that joint i can make."""
    return Motion(float(box.lower[i] - q[i]), float(box.upper[i] - q[i]), bool(form[i]))


def places(box: Mechanism, form: Flags, i: int, count: int = 3) -> Array:
    """Return values of joint i, inside its limits, that determine its form best, (count,)."""
    low, high = box.lower[i], box.upper[i]
    middle, width = (low + high) / 2, max(high - low, 1e-6)
    if form[i]:
        # Over a full turn the values are evenly spaced also from the last to the first.
        width = min(width, TURN * (1 - 1 / count))
    return np.asarray(middle + width * (np.arange(count) / (count - 1) - 0.5))


def basis(delta: Array, turns: bool) -> Array:
    """Return columns 1, cos δ, sin δ, or 1, δ, δ², (k, 3)."""
    if turns:
        return np.stack([np.ones(len(delta)), np.cos(delta), np.sin(delta)], axis=1)
    return np.stack([np.ones(len(delta)), delta, delta**2], axis=1)


def turning(box: Mechanism) -> Flags:
    """Test whether each joint gives a sinusoid, True, or a parabola, False, (n,).

    Raises:
        InvalidSolver: A joint gives neither at one of several places.
    """
    form = np.zeros(box.dof, dtype=bool)
    for i, kind in enumerate(box.kinds):
        possible = [True, False] if kind == NUMBER else [kind != PRISMATIC]
        misfit = np.max([misfits(box, i, place, possible) for place in sample_joints(box, PLACES)], axis=0)
        best = int(np.argmin(misfit))
        if misfit[best] > FITS:
            raise InvalidSolver(
                "coordinate descent needs joints that turn about an axis or slide along one, so that the squared "
                f"error is a sinusoid or a parabola; joint {box.joint_names[i]!r} of {box.name!r} deviates from "
                f"{'both' if len(possible) == 2 else 'the form of its kind'} by {misfit[best]:.2g} of its motion. "
                f"Searches that support it: {others()}"
            )
        form[i] = possible[best]
    return form


def others() -> str:
    """Return the names of searches without this requirement."""
    return listed(lambda traits: not traits.axes and not traits.plain_joints)


def misfits(box: Mechanism, i: int, place: Array, possible: list[bool]) -> list[float]:
    """Return the misfit of each possible form along joint i, relative to the joint's effect.

    The entries of the pose itself are fitted, by (1, cos q, sin q) or (1, q). Then every squared error of them is a sinusoid
    or a parabola.
    """
    rows = np.repeat(place[None], PROBES, axis=0)
    rows[:, i] = np.linspace(box.lower[i], box.upper[i], PROBES)
    poses = box.forward(rows)
    if np.isnan(poses).any():
        raise InvalidSolver(
            "coordinate descent fits the error along each joint over its whole range, and joint "
            f"{box.joint_names[i]!r} of {box.name!r} cannot go everywhere there. Searches that support it: {others()}"
        )
    entries = features(poses, None, (0, 1, 2))
    moved = np.abs(entries - entries.mean(axis=0)).max()
    result = []
    for turns in possible:
        B = basis(rows[:, i] - rows[:, i].mean(), turns)[:, : 3 if turns else 2]
        left = entries - B @ np.linalg.lstsq(B, entries, rcond=None)[0]
        result.append(float(np.abs(left).max() / max(moved, 1e-6 * np.abs(entries).max())))
    return result
