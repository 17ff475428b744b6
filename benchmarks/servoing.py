"""Servoing: time of a step, whether joints keep to their speeds, and whether the end of a branch is predicted in time.

Lines of 0.4 m and circles of 0.15 m at 100 Hz, 5 s each, placed so that every pose can be reached. Joints move at most 1.5
rad/s. Every tracker begins at the joint values that made the task and gets one pose at a time. A task is lost where the
hand is first farther off than 1 mm or 0.01 rad, by plain NumPy forward kinematics.

Foresight: `foresee()` is called ten times a second, and knows only the poses so far. A prediction is right if the hand
begins to fall behind within 0.25 s of the predicted time. A lost task was announced if a right prediction was made at least
0.5 s before. Tasks that are lost in their first 0.6 s cannot be announced, and are not counted. A false alarm is a task
with a prediction that did not come true, unless it was for a time after the end of the task. The branch that `continuing()`
returns is tried: a tracker on it follows the true poses until half a second after the place where the hand was lost.

    python -m benchmarks.servoing                 # writes benchmarks/servoing.md
    python -m benchmarks.servoing --quick         # ten tasks an arm, printed and not written
"""

from __future__ import annotations

import time
from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek import TrackStatus

from .command import at_least_one, command, writes
from .field.adapters import path_of
from .field.judge import bundled
from .page import Page
from .paths import TASK_ARMS, placement
from .targets import plain_fk, pose_errors
from .workers.motion import TRACKERS
from .workers.process import called, releases

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

PERIOD, VELOCITY = 0.01, 1.5
"""[s], [rad/s]"""

PLACE, TURN = 1e-3, 1e-2
"""Farther off than this a pose is lost [m], [rad]."""

ASKED, AHEAD, RIGHT, EARLY = 10, 0.5, 0.25, 0.6
"""Periods between two questions; how long before is in time, how exact is right, what is lost too early to count [s]."""

Row = dict[str, object]
"""Cells of a line of a table by the names of its columns."""

NOISES = (0.0, 1e-4)
"""Of the places of the poses, standard deviation along each axis [m]."""


@dataclass(frozen=True)
class Prediction:
    """What was predicted in one task."""

    lost: int | None
    """The period at which the hand was lost."""
    behind: int | None
    """The period at which it began to fall behind."""
    right: int | None
    """The first period at which this was predicted rightly."""
    false: int
    """Number of predictions that did not come true."""
    status: str
    """The status of the first right prediction."""
    branch: str
    """The branch that was returned then: `goes on` or `ends`. If none was, `overlooked` if a solution of the pose continues,
    otherwise `none`."""


def summary(arm: kinseek.Arm, who: str, q: Array, times: Array, paths: Array, starts: Array) -> Row:
    """Judge all tasks of one tracker: q (P, N, n), times (P, N) [µs], poses (P, N, 4, 4) and starts (P, n)."""
    lost = [lost_at(arm, one, T) is not None for one, T in zip(q, paths, strict=True)]
    moves = np.abs(np.diff(np.concatenate([starts[:, None], q], axis=1), axis=1)).max(axis=(1, 2))
    outside = ((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=(1, 2))
    return _steps(arm, who, len(paths)) | {
        ">median µs": f"{np.median(times):.1f}",
        ">p99 µs": f"{np.percentile(times, 99):.1f}",
        ">followed": len(paths) - sum(lost),
        ">too fast": int((moves > VELOCITY * PERIOD * (1 + 1e-9)).sum()),
        ">outside limits": int(outside.sum()),
    }


def _steps(arm: kinseek.Arm, who: str, tasks: int, why: str = "") -> Row:
    """A row without figures."""
    columns = ">median µs", ">p99 µs", ">followed", ">too fast", ">outside limits"
    return {"arm": arm.name, "who": who, ">tasks": tasks} | dict.fromkeys(columns, "–") | {"": why}


def lost_at(arm: kinseek.Arm, q: Array, T: Array) -> int | None:
    """The first period in which the hand is farther off than it may be, by plain forward kinematics."""
    place, turn = pose_errors(plain_fk(arm.chain, q), T)
    away = np.flatnonzero((place > PLACE) | (turn > TURN))
    return int(away[0]) if len(away) else None


def measure_kinseek(arm: kinseek.Arm, paths: Array, starts: Array) -> Row:
    """Track every task, and time every step."""
    q, times = np.empty((*paths.shape[:2], arm.dof)), np.empty(paths.shape[:2])
    for i, (T, start) in enumerate(zip(paths, starts, strict=True)):
        tracker = arm.track(start, period=PERIOD, velocity=VELOCITY)
        for k, row in enumerate(T):
            began = time.perf_counter_ns()
            answer = tracker.step(row)
            times[i, k] = (time.perf_counter_ns() - began) / 1e3
            q[i, k] = answer.q
    return summary(arm, "**kinseek**", q, times, paths, starts)


def measure_peer(arm: kinseek.Arm, peer: str, paths: Array, starts: Array) -> tuple[Row, str]:
    """Let a peer track every task in its environment; the row, and the peer's version."""
    name = TRACKERS[peer][0]
    place = HERE / "workers" / name if name == "placo" else path_of(name)
    task = {"paths": paths, "starts": starts, "period": PERIOD, "velocity": VELOCITY}
    arguments = {"peer": peer, "arm": asdict(bundled(arm.name).arm)} | task
    found = called(place, "benchmarks.workers.motion", "track", 900, **arguments)
    if isinstance(found, str):
        return _steps(arm, peer, len(paths), found), ""
    q, times = np.array(found["q"]), np.array(found["times"])
    return summary(arm, peer, q, times, paths, starts), found["version"]


def foresight(arm: kinseek.Arm, T: Array, start: Array) -> tuple[Prediction, list[float], list[float]]:
    """Track one task, and ask what comes; also what the questions cost [µs]: of `foresee`, and of `continuing`."""
    tracker, tracked, q = arm.track(start, period=PERIOD, velocity=VELOCITY), [], []
    told: list[tuple[int, float, TrackStatus, Array | None]] = []
    costs, more = [], []
    for k, row in enumerate(T):
        answer = tracker.step(row)
        tracked.append(answer.status is TrackStatus.TRACKING)
        q.append(answer.q)
        if k % ASKED or not k or not tracked[-1]:
            continue
        began = time.perf_counter_ns()
        ahead = tracker.foresee()
        costs.append((time.perf_counter_ns() - began) / 1e3)
        if ahead.status is not TrackStatus.TRACKING:
            began = time.perf_counter_ns()
            branch = tracker.continuing()
            more.append((time.perf_counter_ns() - began) / 1e3)
            told.append((k, k + ahead.seconds / PERIOD, ahead.status, branch))
    lost = lost_at(arm, np.array(q), T)
    behind = None
    if lost is not None:
        behind = lost
        while behind and not tracked[behind - 1]:
            behind -= 1
    until = len(T) if behind is None else behind
    good = [one for one in told if behind is not None and abs(one[1] - behind) * PERIOD <= RIGHT]
    false = [one for one in told if one[0] < until and one not in good and one[1] < len(T)]
    if not good or lost is None:
        return Prediction(lost, behind, None, len(false), "", ""), costs, more
    k, _, status, branch = good[0]
    verdict = judged(arm, branch, T[k : lost + round(0.5 / PERIOD)])
    return Prediction(lost, behind, k, len(false), status.name, verdict), costs, more


def judged(arm: kinseek.Arm, branch: Array | None, T: Array) -> str:
    """Was the right branch returned for poses, (N, 4, 4)? See `Prediction.branch`."""
    if branch is not None:
        return "goes on" if goes_on(arm, branch, T) else "ends"
    return "overlooked" if any(goes_on(arm, q, T) for q in arm.branches(T[0], count=60).q) else "none"


def goes_on(arm: kinseek.Arm, start: Array, T: Array) -> bool:
    """Does the hand go on along poses, (N, 4, 4), from joint values?"""
    tracker = arm.track(start, period=PERIOD, velocity=VELOCITY)
    return lost_at(arm, np.array([tracker.step(row).q for row in T]), T) is None


def measure_foresight(arm: kinseek.Arm, paths: Array, starts: Array, noise: float) -> Row:
    """Ask in every task what comes."""
    rng, each, costs, more = np.random.default_rng(3), [], [], []
    for T, start in zip(paths, starts, strict=True):
        shaken = T.copy()
        shaken[:, :3, 3] += rng.normal(scale=noise, size=(len(T), 3)) if noise else 0.0
        told, cost, branch_cost = foresight(arm, shaken, start)
        each.append(told)
        costs += cost
        more += branch_cost
    lost = [one for one in each if one.lost is not None]
    counted = [one for one in lost if (one.lost or 0) * PERIOD >= EARLY]
    announced = [
        one
        for one in counted
        if one.right is not None and one.behind is not None and (one.behind - one.right) * PERIOD >= AHEAD
    ]
    reasons = Counter(one.status for one in announced)
    branches = [one.branch for one in announced]
    return {
        "arm": arm.name,
        ">noise mm": f"{1e3 * noise:g}",
        ">tasks": len(each),
        ">lost": len(lost),
        ">too early": len(lost) - len(counted),
        ">announced": f"{len(announced)} of {len(counted)}",
        ">false alarms": f"{sum(one.false > 0 for one in each)} of {len(each)}",
        ">branch named": sum(branch in ("goes on", "ends") for branch in branches),
        ">goes on": branches.count("goes on"),
        ">overlooked": branches.count("overlooked"),
        "why": ", ".join(f"{count} {name}" for name, count in reasons.most_common()),
        ">foresee µs": f"{np.median(costs):.0f}",
        ">continuing µs": f"{np.median(more) if more else np.nan:.0f}",
    }


def page(steps: list[Row], foreseen: list[Row], versions: dict[str, str]) -> Page:
    """The page."""
    page = Page("Servoing", "benchmarks.servoing", note=releases(versions))
    page.say(
        f"Lines and circles at {1 / PERIOD:.0f} Hz. The joints may move at {VELOCITY} rad/s, and each tracker makes one",
        "step a period, beginning at the joint values from which the task was made. A task is followed if the hand is",
        f"never farther off than {1e3 * PLACE:g} mm and {TURN:g} rad, by plain NumPy forward kinematics. Every pose can",
        "be reached, but the branch on which a task begins may end at a joint limit or at a singularity, or a joint may be",
        "too slow. *Too fast* and *outside limits* count the tasks in which a joint exceeds its speed limit or leaves its",
        "range.",
    )
    page.rows(steps)
    page.head("Foresight")
    page.say(
        "`tracker.foresee` predicts the coming poses from those so far. On lines and circles the prediction is exact, so",
        "the table also has rows with noise on the positions.",
        "",
        f"- **lost**: tasks in which the hand loses its pose. **too early**: of these, tasks lost in the first {EARLY} s,",
        "  which cannot be announced in time.",
        f"- **announced**: of the other lost tasks, those reported at least {AHEAD} s before the hand fell behind, with",
        f"  the time right to {RIGHT} s.",
        "- **false alarms**: tasks in which something was reported that did not happen before their end.",
        "- **branch named**: `tracker.continuing` returned a branch. **goes on**: on that branch the hand follows the",
        "  true poses until half a second after the place where it was lost. **overlooked**: no branch was returned,",
        "  although one exists.",
    )
    page.rows(foreseen)
    return page


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("--arms", nargs="+", choices=TASK_ARMS, default=TASK_ARMS, help="names")
    parser.add_argument("--peers", nargs="*", choices=list(TRACKERS), default=list(TRACKERS), help="names")
    parser.add_argument("--tasks", type=at_least_one, default=200, help="lines and circles an arm")
    parser.add_argument("--quick", action="store_true", help="ten tasks an arm; nothing is written")
    writes(parser, "--output", HERE / "servoing.md", "page to write")
    options = parser.parse_args()
    steps, foreseen, versions = [], [], {}
    for name in options.arms:
        arm, rng = kinseek.load(name), np.random.default_rng(11)
        count = 10 if options.quick else options.tasks
        tasks = [placement(arm, "line" if i % 2 else "circle", rng) for i in range(count)]
        paths, starts = np.array([T for T, _ in tasks]), np.array([q for _, q in tasks])
        steps.append(measure_kinseek(arm, paths, starts))
        print(steps[-1], flush=True)
        for peer in options.peers:
            row, versions[peer] = measure_peer(arm, peer, paths, starts)
            steps.append(row)
            print(steps[-1], flush=True)
        for noise in NOISES:
            foreseen.append(measure_foresight(arm, paths, starts, noise))
            print(foreseen[-1], flush=True)
    if not options.quick:
        page(steps, foreseen, versions).write(options.output)


if __name__ == "__main__":
    main()
