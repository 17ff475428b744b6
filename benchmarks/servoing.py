"""Servoing: time of a step, whether joints keep to their speeds, and whether the end of a branch is predicted in time.

Lines of 0.4 m and circles of 0.15 m at 100 Hz, 5 s each, placed so that every pose can be reached. Joints move at most 1.5
rad/s. Every tracker begins at the joint values that made the task and gets one pose at a time. A task is lost as soon
as the hand is more than 1 mm or 0.01 rad off, by plain NumPy forward kinematics: the branch on which a task begins may end
at a joint limit or at a singularity, or a joint may be too slow. *Too fast* and *outside limits* count the tasks in which a
joint exceeds its speed limit or leaves its range.

    python -m benchmarks.servoing                 # writes benchmarks/servoing.md
    python -m benchmarks.servoing --quick         # ten tasks an arm, printed and not written
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

import kinseek
from kinseek import TrackStatus

from .command import command
from .page import Page, Row
from .paths.curves import TASK_ARMS, placements
from .targets import Array, plain_fk, pose_errors
from .timing import timed
from .workers.motion import TRACK, TRACKERS
from .workers.process import called, releases

PERIOD, VELOCITY = 0.01, 1.5
"""[s], [rad/s]"""

PLACE, TURN = 1e-3, 1e-2
"""Farther off than this a pose is lost [m], [rad]."""

ASKED, AHEAD, RIGHT, EARLY = 10, 0.5, 0.25, 0.6
"""Periods between two questions; how long before is in time, how exact is right, what is lost too early to count [s]."""

NOISES = (0.0, 1e-4)
"""Of the places of the poses, standard deviation along each axis [m]."""


@dataclass
class Foresight:
    """What was predicted in one task, and what the questions cost."""

    lost: int | None = None
    """The period at which the hand was lost."""
    behind: int | None = None
    """The period at which it began to fall behind."""
    right: int | None = None
    """The first period at which this was predicted rightly."""
    false: int = 0
    """Number of predictions that did not come true."""
    status: str = ""
    """The status of the first right prediction."""
    branch: str = ""
    """The branch that was returned then: `goes on` or `ends`. If none was, `overlooked` if a solution of the pose continues,
    otherwise `none`."""
    foresee: list[float] = field(default_factory=list)
    """Times of `foresee` [µs]."""
    continuing: list[float] = field(default_factory=list)
    """Times of `continuing` [µs]."""

    @property
    def counts(self) -> bool:
        """Was the hand lost, and so late that this could be announced?"""
        return self.lost is not None and self.lost * PERIOD >= EARLY

    @property
    def announced(self) -> bool:
        """Was that predicted rightly, and in time?"""
        in_time = self.right is not None and self.behind is not None
        return self.counts and in_time and ((self.behind or 0) - (self.right or 0)) * PERIOD >= AHEAD


def lost_at(arm: kinseek.Arm, q: Array, T: Array) -> int | None:
    """The first period in which the hand is farther off than it may be, by plain forward kinematics."""
    place, turn = pose_errors(plain_fk(arm.chain, q), T)
    away = np.flatnonzero((place > PLACE) | (turn > TURN))
    return int(away[0]) if len(away) else None


def steps(arm: kinseek.Arm, who: str, found: dict[str, Array] | str, paths: Array, starts: Array) -> Row:
    """A row about all tasks of one tracker: `q` (P, N, n) and `times` (P, N) [µs]; or why there is nothing."""
    cells: Row = {"arm": arm.name, "who": who, ">tasks": len(paths)}
    columns = ">median µs", ">p99 µs", ">followed", ">too fast", ">outside limits"
    if isinstance(found, str):
        return cells | dict.fromkeys(columns, "–") | {"": found}
    q, times = np.array(found["q"]), np.array(found["times"])
    lost = [lost_at(arm, one, T) is not None for one, T in zip(q, paths, strict=True)]
    moves = np.abs(np.diff(np.concatenate([starts[:, None], q], axis=1), axis=1)).max(axis=(1, 2))
    outside = ((q < arm.lower - 1e-9) | (q > arm.upper + 1e-9)).any(axis=(1, 2))
    figures = (
        f"{np.median(times):.1f}",
        f"{np.percentile(times, 99):.1f}",
        len(paths) - sum(lost),
        int((moves > VELOCITY * PERIOD * (1 + 1e-9)).sum()),
        int(outside.sum()),
    )
    return cells | dict(zip(columns, figures, strict=True)) | {"": ""}


def by_kinseek(arm: kinseek.Arm, paths: Array, starts: Array) -> dict[str, Array]:
    """Track every task, and time every step."""
    q, times = np.empty((*paths.shape[:2], arm.dof)), np.empty(paths.shape[:2])
    for i, (T, start) in enumerate(zip(paths, starts, strict=True)):
        answers, times[i] = timed(arm.track(start, period=PERIOD, velocity=VELOCITY).step, T)
        q[i] = [answer.q for answer in answers]
    return {"q": q, "times": times}


def compared(
    arm: kinseek.Arm, peers: list[str], paths: Array, starts: Array, versions: dict[str, str]
) -> Iterator[Row]:
    """A row of kinseek, and one of every peer, which tracks in its own environment."""
    yield steps(arm, "**kinseek**", by_kinseek(arm, paths, starts), paths, starts)
    task = {"paths": paths, "starts": starts, "period": PERIOD, "velocity": VELOCITY}
    for peer in peers:
        found = called(TRACKERS[peer][0], *TRACK, arm=arm.name, peer=peer, **task)
        versions[peer] = "" if isinstance(found, str) else found["version"]
        yield steps(arm, peer, found, paths, starts)


def foresight(arm: kinseek.Arm, T: Array, start: Array) -> Foresight:
    """Track one task, and ask what comes."""
    tracker, tracked, q = arm.track(start, period=PERIOD, velocity=VELOCITY), [], []
    told: list[tuple[int, float, TrackStatus, Array | None]] = []
    made = Foresight()
    for k, row in enumerate(T):
        answer = tracker.step(row)
        tracked.append(answer.status is TrackStatus.TRACKING)
        q.append(answer.q)
        if k % ASKED or not k or not tracked[-1]:
            continue
        (ahead,), cost = timed(lambda _: tracker.foresee(), [0])
        made.foresee += cost.tolist()
        if ahead.status is not TrackStatus.TRACKING:
            (branch,), cost = timed(lambda _: tracker.continuing(), [0])
            made.continuing += cost.tolist()
            told.append((k, k + ahead.seconds / PERIOD, ahead.status, branch))
    lost = made.lost = made.behind = lost_at(arm, np.array(q), T)
    while made.behind and not tracked[made.behind - 1]:
        made.behind -= 1
    behind = made.behind
    until = len(T) if behind is None else behind
    good = [one for one in told if behind is not None and abs(one[1] - behind) * PERIOD <= RIGHT]
    made.false = sum(one[0] < until and one not in good and one[1] < len(T) for one in told)
    if good and lost is not None:
        made.right, _, status, branch = good[0]
        made.status = status.name
        made.branch = judged(arm, branch, T[made.right : lost + round(0.5 / PERIOD)])
    return made


def judged(arm: kinseek.Arm, branch: Array | None, T: Array) -> str:
    """Was the right branch returned for poses, (N, 4, 4)? See `Foresight.branch`."""
    if branch is not None:
        return "goes on" if goes_on(arm, branch, T) else "ends"
    return "overlooked" if any(goes_on(arm, q, T) for q in arm.branches(T[0], count=60).q) else "none"


def goes_on(arm: kinseek.Arm, start: Array, T: Array) -> bool:
    """Does the hand go on along poses, (N, 4, 4), from joint values?"""
    tracker = arm.track(start, period=PERIOD, velocity=VELOCITY)
    return lost_at(arm, np.array([tracker.step(row).q for row in T]), T) is None


def foreseen(arm: kinseek.Arm, paths: Array, starts: Array, noise: float) -> Row:
    """A row about what was predicted in all tasks, with noise on the places of the poses [m]."""
    rng, each = np.random.default_rng(3), []
    for T, start in zip(paths, starts, strict=True):
        shaken = T.copy()
        shaken[:, :3, 3] += rng.normal(scale=noise, size=(len(T), 3)) if noise else 0.0
        each.append(foresight(arm, shaken, start))
    announced = [one for one in each if one.announced]
    reasons, branches = Counter(one.status for one in announced), [one.branch for one in announced]
    lost, counted = sum(one.lost is not None for one in each), sum(one.counts for one in each)
    more = [cost for one in each for cost in one.continuing]
    return {
        "arm": arm.name,
        ">noise mm": f"{1e3 * noise:g}",
        ">tasks": len(each),
        ">lost": lost,
        ">too early": lost - counted,
        ">announced": f"{len(announced)} of {counted}",
        ">false alarms": f"{sum(one.false > 0 for one in each)} of {len(each)}",
        ">branch named": sum(branch in ("goes on", "ends") for branch in branches),
        ">goes on": branches.count("goes on"),
        ">overlooked": branches.count("overlooked"),
        "why": ", ".join(f"{count} {name}" for name, count in reasons.most_common()),
        ">foresee µs": f"{np.median([cost for one in each for cost in one.foresee]):.0f}",
        ">continuing µs": f"{np.median(more) if more else np.nan:.0f}",
    }


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__, __doc__, arms=TASK_ARMS, page="servoing.md", tasks=(200, 10, "lines and circles an arm")
    )
    parser.add_argument("--peers", nargs="*", choices=TRACKERS, default=list(TRACKERS), help="names")
    options = parser.options()
    kinds = ["line" if i % 2 else "circle" for i in range(options.tasks)]
    arms = [kinseek.load(name) for name in options.arms]
    tasks = [(arm, *placements(arm, kinds, 11)) for arm in arms]
    page, versions = Page("Servoing", "benchmarks.servoing", __doc__), dict[str, str]()
    page.rows(
        row for arm, paths, starts in tasks for row in compared(arm, options.peers, paths, starts, versions)
    )
    page.note = releases(versions)
    page.head("Foresight")
    page.say(
        "`foresee()` is called ten times a second, and knows only the poses so far. On lines and circles its prediction is",
        "exact, so the table also has rows with noise on the positions.",
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
    page.rows(foreseen(arm, paths, starts, noise) for arm, paths, starts in tasks for noise in NOISES)
    page.end(options)


if __name__ == "__main__":
    main()
