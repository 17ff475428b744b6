"""Explain in words why a path breaks: a limit, a singularity, a pose out of reach, or rejection by the user."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import constraint_jacobian
from kinseek.robots.mechanism import Mechanism

from .allowed import Allowed
from .between import apart
from .joints import Turning
from .layers import Layers
from .path import Path, intervals, met
from .request import PathRequest
from .steps import beyond_a_step

Array = NDArray[np.float64]

NEAR_SINGULAR = 0.05
"""Least singular value of the Jacobian, relative to the largest, below which a singularity is given as the reason. Not
examined further."""


def reasons(request: PathRequest, path: Path, wide: Layers | None) -> tuple[str, ...]:
    """Return a sentence for each run of missed poses and each break between two reached poses, in order."""
    there = met(path)
    refused = ~path.reached & there & path.planned
    report = [(first, _late(first, last)) for first, last in intervals(~path.planned)]
    report += [(first, _missed(path, first, last)) for first, last in intervals(~there & path.planned)]
    report += [(first, _refused(request, path, first, last, wide)) for first, last in intervals(refused)]
    report += [(int(i), _break(request, path, int(i), wide)) for i in path.breaks]
    return tuple(text for _, text in sorted(report))


def _refused(request: PathRequest, path: Path, first: int, last: int, wide: Layers | None) -> str:
    """Explain why poses have solutions, but none that is allowed."""
    which, valid, i = these(first, last), request.valid, (first + last) // 2
    assert valid is not None
    if request.deadline.passed:
        return f"{which} blocked: each solution found within the time limit hits something or is rejected by valid"
    q = path.q[i : i + 1]
    given = (i == 0 and request.start is not None) or (i == len(path.q) - 1 and request.end is not None)
    if wide is not None and not given:
        turning = Turning(request.problem.chain)
        every = turning.first_turn(wide.at(i))
        every = every[turning.inside(every)]
        q = every if len(every) else q
    free = valid.free(q)
    if valid.scene is None or free.any():
        hits = "hit something or that " if not free.all() else ""
        return f"{which} reached only by joint values that {hits}valid rejects"
    least = q[int(np.argmax(valid.scene.distance(q)))]
    where = "" if first == last else f"at pose {i}, "
    near = f" or comes nearer than {valid.clearance:g} m" if valid.clearance else ""
    return (
        f"{which} blocked: in every solution found the arm hits something{near}; {where}in the one that collides least: "
        f"{valid.against(least)}"
    )


def these(first: int, last: int) -> str:
    """Return the poses of an interval as the subject of a sentence, with its verb."""
    return f"pose {first} is" if first == last else f"poses {first} to {last} are"


def _late(first: int, last: int) -> str:
    return f"{these(first, last)} not planned: the time limit was reached"


def _missed(path: Path, first: int, last: int) -> str:
    which = these(first, last)
    place = path.position_error[first : last + 1].max()
    turn = path.orientation_error[first : last + 1].max()
    return f"{which} out of reach: the nearest found is up to {place:.3g} m and {turn:.3g} rad off"


def _break(request: PathRequest, path: Path, i: int, wide: Layers | None) -> str:
    count = len(path.q)
    following = (i + 1) % count
    begin = f"between poses {i} and {following}"
    if request.deadline.passed:
        return f"{begin}: the time limit was reached before a continuous motion was found"
    target = request.problem.goal.target
    distance, turn = apart(target[i : i + 1], target[following : following + 1])
    chain = request.problem.chain
    longest = request.longest[i]
    if any(beyond.any() for beyond in beyond_a_step(chain, longest[None], distance, turn)):
        report = f"{distance[0]:.3g} m and {turn[0]:.3g} rad apart"
        return f"{begin}: they are {report}, farther than the joints may move in one step"
    if i == count - 1:
        return f"{begin}: the motion does not come back to where it began"
    if wide is None:
        gap = Turning(chain).way(path.q[following] - path.q[i])
        step = np.abs(gap)
        if request.valid is not None and (step <= longest).all():
            what = request.valid.against_way(path.q[i], path.q[i] + gap)
            return f"{begin}: no sampled solution continues the motion; on the way to the one chosen {what}"
        joint = int(np.argmax(step / longest))
        far = _too_far(chain, joint, step[joint], longest[joint])
        return f"{begin}: no sampled solution continues the motion; to reach the one chosen, {far}"
    end_before, ended = _end_of_branch(request, path.q[i], i, wide, 1)
    begin_after, began = _end_of_branch(request, path.q[following], following, wide, -1)
    return (
        f"{begin}: the branch before it ends {_at(end_before, count)} ({ended}), "
        f"the one after it begins {_at(begin_after, count)} ({began})"
    )


def _at(i: int, count: int) -> str:
    return "with the path" if i in (-1, count) else f"at pose {i}"


def _end_of_branch(request: PathRequest, q: Array, i: int, wide: Layers, way: int) -> tuple[int, str]:
    """Follow a branch from joint values at pose i; return the pose where it ends, and the reason."""
    problem, turning = request.problem, Turning(request.problem.chain)
    names = problem.mechanism.joint_names
    while True:
        if request.deadline.passed:
            return i, "the time limit was reached"
        j = i + way
        # The layers of a piece of a stream include those of the look-ahead.
        if not 0 <= j < min(len(wide), len(request)):
            return (
                j,
                "it continues to the end of the path"
                if way > 0
                else "it goes back to the beginning of the path",
            )
        longest = request.longest[min(i, j)]
        steps = turning.step(wide.at(j) - q)
        if not len(steps):
            return j, "nothing reaches the pose"
        nearest = int(np.argmin(np.abs(steps / longest).max(axis=1)))
        step = steps[nearest]
        # The branch does not continue: near a singularity because it vanishes there, otherwise because it moves too fast.
        if (np.abs(step) > longest).any():
            J = constraint_jacobian(problem, q[None])[0]
            values = np.linalg.svd(J, compute_uv=False)
            least = values[min(J.shape) - 1] / values[0]
            joint = int(np.argmax(np.abs(step) / longest))
            far = _too_far(problem.mechanism, joint, abs(step[joint]), longest[joint])
            singular = f"a singularity: the least singular value is {least:.2g} of the largest"
            return i, singular if least < NEAR_SINGULAR else far
        q, i = q + step, j
        low = q < turning.open_lower - 1e-9
        high = q > turning.open_upper + 1e-9
        if (low | high).any():
            joint = int(np.flatnonzero(low | high)[0])
            side, limit = ("lower", turning.lower) if low[joint] else ("upper", turning.upper)
            return i, f"joint {names[joint]!r} reaches its {side} limit {limit[joint]:.4g}"
        if request.valid is not None and (report := _against(request.valid, q - step, q)):
            return i, report


def _too_far(arm: Mechanism, joint: int, step: float, longest: float) -> str:
    """Say that a step moves a joint farther than it may."""
    unit = "m" if arm.kinds[joint] == "prismatic" else "rad"
    return f"joint {arm.joint_names[joint]!r} would move {step:.3g} {unit} in one step; {longest:.3g} {unit} is allowed"


def _against(valid: Allowed, a: Array, b: Array) -> str:
    """Describe why b, or the straight step from a to b, is not allowed; an empty string if both are allowed."""
    if not valid(b):
        return valid.against(b)
    return "" if valid.ways(a[None], b[None])[0] else f"on the way there {valid.against_way(a, b)}"
