"""Servoing: what one step costs, whether joints stay within their speeds, and whether an end of the way is told in time.

Lines of 0.4 m and circles of 0.15 m at 100 Hz, 5 s each, somewhere in the arm's reach so that every pose can be reached;
joints at most 1.5 rad/s; every tracker begins at the joint values that made the task and knows one pose at a time. A task is
lost where the hand is first farther off than 1 mm or 0.01 rad, by plain NumPy forward kinematics.

Foresight: `foresee()` is asked ten times a second, and knows no more than the poses so far. What it tells is right if the
hand begins to fall behind within 0.25 s of when it said. A task that was lost was announced if something right was told at
least 0.5 s before; one that was lost in its first 0.6 s cannot be, and is not counted. A false alarm is a task in which
something was told that did not come, unless it was told for a time after the end of the task. The branch that `continuing()`
names is tried: a tracker that stands there goes along the true poses, half a second past where the hand was lost.

    python -m benchmarks.servoing                 # writes servoing.md beside this file
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

NOISES = (0.0, 1e-4)
"""Of the places of the poses, standard deviation along each axis [m]."""


@dataclass(frozen=True)
class Steps:
    """How one tracker did on all tasks of an arm."""

    arm: str
    who: str
    tasks: int
    median: float
    """[µs]"""
    p99: float
    """[µs]"""
    followed: int
    fast: int
    """Tasks in which a joint was faster than allowed."""
    outside: int
    """Tasks in which a joint left its limits."""
    note: str = ""
    release: str = ""


@dataclass(frozen=True)
class Told:
    """What was foreseen in one task."""

    lost: int | None
    """At which period the hand was lost."""
    behind: int | None
    """At which period it had begun to fall behind."""
    right: int | None
    """When that was first told rightly."""
    false: int
    """How often something was told that did not come."""
    status: str
    """Of the first that was right."""
    branch: str
    """Of the branch that was named then: `goes on` or `ends`; where none was, `overlooked` if an answer to the pose does go
    on, else `none`."""


def summary(
    arm: kinseek.Arm, who: str, q: Array, times: Array, paths: Array, starts: Array, release: str
) -> Steps:
    """Judge all tasks of one tracker: q (P, N, n), times (P, N) [µs], poses (P, N, 4, 4) and starts (P, n)."""
    lost = [lost_at(arm, one, T) is not None for one, T in zip(q, paths, strict=True)]
    moves = np.abs(np.diff(np.concatenate([starts[:, None], q], axis=1), axis=1)).max(axis=(1, 2))
    outside = ((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=(1, 2))
    return Steps(
        arm=arm.name,
        who=who,
        tasks=len(paths),
        median=float(np.median(times)),
        p99=float(np.percentile(times, 99)),
        followed=len(paths) - sum(lost),
        fast=int((moves > VELOCITY * PERIOD * (1 + 1e-9)).sum()),
        outside=int(outside.sum()),
        release=release,
    )


def lost_at(arm: kinseek.Arm, q: Array, T: Array) -> int | None:
    """The first period in which the hand is farther off than it may be, by plain forward kinematics."""
    place, turn = pose_errors(plain_fk(arm.chain, q), T)
    away = np.flatnonzero((place > PLACE) | (turn > TURN))
    return int(away[0]) if len(away) else None


def measure_kinseek(arm: kinseek.Arm, paths: Array, starts: Array) -> Steps:
    """Track every task, and time every step."""
    q, times = np.empty((*paths.shape[:2], arm.dof)), np.empty(paths.shape[:2])
    for i, (T, start) in enumerate(zip(paths, starts, strict=True)):
        tracker = arm.track(start, period=PERIOD, velocity=VELOCITY)
        for k, row in enumerate(T):
            began = time.perf_counter_ns()
            answer = tracker.step(row)
            times[i, k] = (time.perf_counter_ns() - began) / 1e3
            q[i, k] = answer.q
    return summary(arm, "kinseek", q, times, paths, starts, kinseek.__version__)


def measure_peer(arm: kinseek.Arm, peer: str, paths: Array, starts: Array) -> Steps:
    """Let a peer track every task in its environment."""
    name = TRACKERS[peer][0]
    place = HERE / "workers" / name if name == "placo" else path_of(name)
    task = {"paths": paths, "starts": starts, "period": PERIOD, "velocity": VELOCITY}
    arguments = {"peer": peer, "arm": asdict(bundled(arm.name).arm)} | task
    found = called(place, "benchmarks.workers.motion", "track", 900, **arguments)
    if isinstance(found, str):
        return Steps(arm.name, peer, len(paths), np.nan, np.nan, 0, 0, 0, found)
    q, times = np.array(found["q"]), np.array(found["times"])
    return summary(arm, peer, q, times, paths, starts, found["version"])


def foresight(arm: kinseek.Arm, T: Array, start: Array) -> tuple[Told, list[float], list[float]]:
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
        return Told(lost, behind, None, len(false), "", ""), costs, more
    k, _, status, branch = good[0]
    verdict = judged(arm, branch, T[k : lost + round(0.5 / PERIOD)])
    return Told(lost, behind, k, len(false), status.name, verdict), costs, more


def judged(arm: kinseek.Arm, branch: Array | None, T: Array) -> str:
    """Was the right branch named for poses, (N, 4, 4)? See `Told.branch`."""
    if branch is not None:
        return "goes on" if goes_on(arm, branch, T) else "ends"
    return "overlooked" if any(goes_on(arm, q, T) for q in arm.branches(T[0], count=60).q) else "none"


def goes_on(arm: kinseek.Arm, start: Array, T: Array) -> bool:
    """Does the hand go on along poses, (N, 4, 4), from joint values?"""
    tracker = arm.track(start, period=PERIOD, velocity=VELOCITY)
    return lost_at(arm, np.array([tracker.step(row).q for row in T]), T) is None


@dataclass(frozen=True)
class Foreseen:
    """What was foreseen on all tasks of one arm."""

    arm: str
    noise: float
    """Of the poses' places, standard deviation along each axis [m]."""
    tasks: int
    lost: int
    early: int
    """Lost in the first `EARLY` seconds."""
    announced: int
    """Of the others, rightly, at least `AHEAD` before the hand fell behind."""
    kept: int
    """Tasks that were not lost."""
    false: int
    """Tasks in which something was told that did not come."""
    named: int
    """Announced tasks in which a branch was named."""
    true: int
    """Of these, from whose branch the hand went on."""
    overlooked: int
    """Announced tasks in which none was named, and one does go on."""
    reasons: str
    cost: float
    """Of `foresee` [µs], median."""
    branch_cost: float
    """Of `continuing` [µs], median."""


def measure_foresight(arm: kinseek.Arm, paths: Array, starts: Array, noise: float) -> Foreseen:
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
    return Foreseen(
        arm=arm.name,
        noise=noise,
        tasks=len(each),
        lost=len(lost),
        early=len(lost) - len(counted),
        announced=len(announced),
        kept=len(each) - len(lost),
        false=sum(one.false > 0 for one in each),
        named=sum(one.branch in ("goes on", "ends") for one in announced),
        true=sum(one.branch == "goes on" for one in announced),
        overlooked=sum(one.branch == "overlooked" for one in announced),
        reasons=", ".join(f"{count} {name}" for name, count in reasons.most_common()),
        cost=float(np.median(costs)),
        branch_cost=float(np.median(more)) if more else np.nan,
    )


def page(steps: list[Steps], foreseen: list[Foreseen]) -> Page:
    """The page."""
    page = Page(
        "Servoing",
        "benchmarks.servoing",
        note=releases({one.who: one.release for one in steps if one.who != "kinseek"}),
    )
    page.say(
        f"Lines and circles at {1 / PERIOD:.0f} Hz, joints at most {VELOCITY} rad/s, one step a period from the joint",
        f"values that made the task. Followed: never farther off than {1e3 * PLACE:g} mm and {TURN:g} rad by NumPy alone.",
    )
    page.table(
        "arm | who | >tasks | >median µs | >p99 µs | >followed | >too fast | >outside limits |",
        [
            (
                one.arm,
                f"**{one.who}**" if one.who == "kinseek" else one.who,
                one.tasks,
                *(
                    (f"{one.median:.1f}", f"{one.p99:.1f}", one.followed, one.fast, one.outside)
                    if not one.note
                    else "–" * 5
                ),
                one.note,
            )
            for one in steps
        ],
    )
    page.head("Foresight")
    page.say(
        f"Announced: told at least {AHEAD} s before the hand fell behind, and when to {RIGHT} s. A task lost in its first",
        f"{EARLY} s cannot be announced in time and is not counted. False: tasks in which something was told that did not",
        "come before their end. The poses to come are guessed from those so far; on lines and circles the guess is exact,",
        "so the same is shown with noise on the places. Goes on: from the branch that was named the hand goes on along the",
        "true poses, half a second past where it was lost. Overlooked: none was named, and one of all answers does.",
    )
    page.table(
        "arm | >noise mm | >tasks | >lost | >too early | >announced | >false alarms | >branch named | >goes on "
        "| >overlooked | why | >foresee µs | >continuing µs",
        [
            (
                one.arm,
                f"{1e3 * one.noise:g}",
                one.tasks,
                one.lost,
                one.early,
                f"{one.announced} of {one.lost - one.early}",
                f"{one.false} of {one.tasks}",
                one.named,
                one.true,
                one.overlooked,
                one.reasons,
                f"{one.cost:.0f}",
                f"{one.branch_cost:.0f}",
            )
            for one in foreseen
        ],
    )
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
    steps, foreseen = [], []
    for name in options.arms:
        arm, rng = kinseek.load(name), np.random.default_rng(11)
        count = 10 if options.quick else options.tasks
        tasks = [placement(arm, "line" if i % 2 else "circle", rng) for i in range(count)]
        paths, starts = np.array([T for T, _ in tasks]), np.array([q for _, q in tasks])
        steps.append(measure_kinseek(arm, paths, starts))
        print(steps[-1], flush=True)
        for peer in options.peers:
            steps.append(measure_peer(arm, peer, paths, starts))
            print(steps[-1], flush=True)
        for noise in NOISES:
            foreseen.append(measure_foresight(arm, paths, starts, noise))
            print(foreseen[-1], flush=True)
    if not options.quick:
        page(steps, foreseen).write(options.output)


if __name__ == "__main__":
    main()
