"""Streams: whether a tracker keeps its limits, comes to rest and stays near its target, and what a step costs.

Targets move in ten ways, at 500 Hz: a smooth curve, jumps, a 6-D mouse of at most 0.2 m/s and 0.8 rad/s, one that is
three times as fast, a joint that runs beyond its limit, a line past the axis of the base, a line through a singularity, out
of reach and back, along the boundary of the reach, and a random walk. Where a target comes to rest it rests for 3 s. Joints
may move at 1.5 rad/s, with at most 20 rad/s², in half of the streams also with at most 1,000 rad/s³.

Velocities, accelerations and jerks are differences of the joint values of successive periods. A step violates a limit if it
exceeds it by more than the rounding of the joint values. The hand is placed by plain NumPy forward kinematics. In the
scenes, MuJoCo counts contacts, with the same shapes and pairs and its own forward kinematics and collisions.

    python -m benchmarks.streams                      # writes benchmarks/streams.md
    python -m benchmarks.streams --steps 10000000     # as many steps in all
    python -m benchmarks.streams --quick              # two arms, printed and not written
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

import kinseek
from kinseek.collision import Box

from .command import command
from .moving import (
    HOLD,
    PERIOD,
    REACHED,
    SETTLED,
    STREAMS,
    Limits,
    Rest,
    Stream,
    Violations,
    lag,
    overshoot,
    periods,
    reach,
    rests,
    stream,
    violations,
)
from .page import Page, Row
from .targets import Array
from .timing import timed
from .workers.motion import TRACK
from .workers.process import called, releases

ARMS = ("ur5e", "panda", "iiwa14", "xarm7", "gen3", "so101", "irb120")

VELOCITY, ACCELERATION, JERK = 1.5, 20.0, 1000.0
"""[rad/s], [rad/s²], [rad/s³]"""

ALL_LIMITS = (Limits(VELOCITY, ACCELERATION), Limits(VELOCITY, ACCELERATION, JERK))

PEERS = {"placo": "velocity", "pink": "velocity, acceleration", "mink": "velocity"}
"""Trackers, and which limits of theirs are set."""

KINDS = ("position", "velocity", "acceleration", "jerk")

BODIES = 20

SCENE_STREAMS = ("smooth", "step", "rough mouse", "across the base axis", "out of reach", "random walk")

STOOD = "no step"

CHUNK, ROUNDS = 250, 12
"""Steps of a tracker before it is another's turn, and how often each has its turn."""

SHOWN = 20
"""Faults that are listed."""

Step = Callable[[Any], Any]


class Tracked(NamedTuple):
    """What a tracker did."""

    q: Array
    """(k, n)"""
    times: Array
    """(k,) [µs]"""
    statuses: list[str]
    """Of a peer `STOOD` where it found no step."""


def begun(arm: kinseek.Arm, q0: Array, limits: Limits, **more: Any) -> kinseek.Tracker:
    """A tracker with these limits."""
    given = {name: value for name, value in limits._asdict().items() if np.isfinite(value)}
    return arm.track(q0, period=PERIOD, **given, **more)


class Behind:
    """Ruckig one step a period, behind a tracker that knows no limits but those of position and velocity.

    Each joint by itself: when synchronized, Ruckig 0.19.4 finds no motion for some of these targets.
    """

    def __init__(self, arm: kinseek.Arm, q0: Array, limits: Limits, moving: bool) -> None:
        """Begin there, with targets that rest or that move as the tracker's joints do."""
        from ruckig import InputParameter, OutputParameter, Ruckig, RuckigError, Synchronization

        self._refusal = RuckigError
        self._tracker, self._moving, self._limits = begun(arm, q0, Limits(VELOCITY)), moving, limits
        self._before = q0
        self._generator, self._out = Ruckig(arm.dof, PERIOD), OutputParameter(arm.dof)
        self._in = given = InputParameter(arm.dof)
        given.current_position = given.target_position = q0.tolist()
        given.max_velocity, given.max_acceleration, given.max_jerk = ([each] * arm.dof for each in limits)
        given.synchronization = Synchronization.No

    def step(self, T: Any) -> Any:
        """One period on; the tracker's answer with other joint values."""
        answer = self._tracker.step(T)
        self._in.target_position = answer.q.tolist()
        if self._moving:
            speeds, most = (answer.q - self._before) / PERIOD, self._limits.velocity
            self._in.target_velocity = np.clip(speeds, -most, most).tolist()
            self._before = answer.q
        try:
            self._generator.update(self._in, self._out)
        except self._refusal:  # It finds no motion from some states: it stands still, as peers do.
            self._in.current_velocity = self._in.current_acceleration = [0.0] * len(answer.q)
            return answer._replace(q=np.array(self._in.current_position), status=SimpleNamespace(name=STOOD))
        self._out.pass_to_input(self._in)
        return answer._replace(q=np.array(self._out.new_position))


STARTS: dict[str, Callable[[kinseek.Arm, Array, Limits], Any]] = {
    "**kinseek**": begun,
    "ruckig behind a tracker": partial(Behind, moving=False),
    "the same, targets that move": partial(Behind, moving=True),
}
"""Trackers in this process."""


def tracked(step: Step, T: Array) -> Tracked:
    """Take every step, and time it."""
    answers, times = timed(step, T)
    return Tracked(np.array([one.q for one in answers]), times, [one.status.name for one in answers])


@dataclass
class Tally:
    """Of many streams."""

    steps: int = 0
    stood: int = 0
    judged: list[Violations] = field(default_factory=list)
    """Of each stream."""
    each: list[tuple[Rest, bool, str]] = field(default_factory=list)
    """Rests, whether their targets can be reached, and the last status."""
    faults: list[str] = field(default_factory=list)

    def count(
        self, arm: kinseek.Arm, made: Stream, limits: Limits, found: Tracked, where: str, aims: bool = True
    ) -> None:
        """Judge what a tracker did on a stream."""
        judged = violations(arm, found.q, made.q0, limits)
        self.judged.append(judged)
        self.steps += len(found.q)
        self.stood += found.statuses.count(STOOD)
        for kind, (row, joint) in judged.first.items():
            size = f"{judged.share[kind]:.3g} {'rad outside' if kind == 'position' else 'of the limit'}"
            number, first = judged.steps[kind], f"the first {row}, joint {joint + 1}"
            self.faults.append(f"{where}: {kind}, {number} steps, {first}; at most {size}")
        for rest in rests(arm.chain, found.q, made.T) if aims else ():
            reachable = bool(arm.ik(made.T[rest.end]).success)
            status = found.statuses[rest.end]
            self.each.append((rest, reachable, status))
            at = f"{where}: target at rest from step {rest.begin}"
            if rest.seconds > SETTLED:
                self.faults.append(f"{at}, the arm after {rest.seconds:.3g} s, {status}")
            if rest.reversals:
                self.faults.append(f"{at}, {rest.reversals} reversals after that, {status}")
            if reachable and not rest.reached:
                off = f"{rest.position:.2g} m, {rest.orientation:.2g} rad"
                self.faults.append(f"{at}, reachable, {off} off after {HOLD:g} s, {status}")

    def __add__(self, other: Tally) -> Tally:
        """Both together."""
        return Tally(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    @property
    def violated(self) -> Counter[str]:
        """Number of steps that violate a limit, by its kind."""
        return sum((Counter(one.steps) for one in self.judged), Counter())

    @property
    def limits(self) -> Row:
        """Cells about limits."""
        cells: Row = {">steps": f"{self.steps:,}"}
        cells |= {f">{kind}": self.violated[kind] for kind in KINDS}
        return cells | {
            f">largest {kind}": f"{max((one.share[kind] for one in self.judged), default=np.nan):.4g}"
            for kind in ("acceleration", "jerk")
        }

    @property
    def rests(self) -> Row:
        """Cells about rests."""
        reachable = [one for one in self.each if one[1]]
        reached = [rest for rest, _, _ in reachable if rest.reached]
        why = Counter(status for rest, _, status in reachable if not rest.reached)
        slowest = max((rest.seconds for rest, _, _ in self.each), default=np.nan)
        return {
            ">rests": len(self.each),
            f">after {SETTLED:g} s": sum(rest.seconds <= SETTLED for rest, _, _ in self.each),
            ">slowest s": f"{slowest:.2f}" if np.isfinite(slowest) else "not at rest",
            ">reversals": sum(rest.reversals for rest, _, _ in self.each),
            ">reachable": len(reachable),
            ">reached": len(reached),
            "the others": ", ".join(f"{count} {name}" for name, count in why.most_common()),
        }


def ours(arm: kinseek.Arm, steps: int) -> dict[str, Tally]:
    """Every stream again and again, until so many steps are done: tallies of the streams."""
    tallies = {kind: Tally() for kind in STREAMS}
    seed = 0
    while sum(tally.steps for tally in tallies.values()) < steps:
        for kind, tally in tallies.items():
            made = stream(arm, kind, seed)
            for limits in ALL_LIMITS:
                found = tracked(begun(arm, made.q0, limits).step, made.T)
                tally.count(arm, made, limits, found, place_of(arm, kind, seed, limits))
        seed += 1
    return tallies


def place_of(arm: kinseek.Arm, kind: str, seed: int, limits: Limits) -> str:
    """How to make a stream again."""
    return f"{arm.name}, {kind!r}, seed {seed}{', jerk limited' if np.isfinite(limits.jerk) else ''}"


def asked_of_peer(arm: kinseek.Arm, peer: str, made: dict[str, Stream]) -> dict[str, Tracked] | str:
    """What a peer does on streams, in its own environment, or why it does nothing; and its version."""
    task = {"paths": [one.T for one in made.values()], "starts": [one.q0 for one in made.values()]}
    limits = {"period": PERIOD, "velocity": VELOCITY, "acceleration": ACCELERATION}
    found = called(peer, *TRACK, arm=arm.name, peer=peer, **task, **limits)
    if isinstance(found, str):
        return found
    VERSIONS[peer] = found["version"]
    rows = zip(made.items(), found["q"], found["times"], found["stood"], strict=True)
    return {
        kind: Tracked(
            unwound(arm, np.array(q), one.q0),
            np.array(times),
            [STOOD if stands else "" for stands in stood],
        )
        for (kind, one), q, times, stood in rows
    }


def unwound(arm: kinseek.Arm, q: Array, q0: Array) -> Array:
    """Joint values without full turns of joints that have no limits, which some peers return between -π and π."""
    whole = np.unwrap(np.concatenate([q0[None], q]), axis=0)[1:]
    return np.where(arm.chain.endless, whole, q)


VERSIONS: dict[str, str] = {}


def compared(arm: kinseek.Arm, peers: list[str], tallies: dict[str, Tally], mice: list[Row]) -> None:
    """All trackers on the streams of one seed: what they violate, and how far they are behind the mouse."""
    made = {kind: stream(arm, kind, 0) for kind in STREAMS}
    for limits in ALL_LIMITS:
        jerk = bool(np.isfinite(limits.jerk))
        who: dict[str, dict[str, Tracked] | str] = {
            name: {kind: tracked(start(arm, one.q0, limits).step, one.T) for kind, one in made.items()}
            for name, start in STARTS.items()
        }
        who |= {} if jerk else {peer: asked_of_peer(arm, peer, made) for peer in peers}
        for name, found in who.items():
            if isinstance(found, str):
                print(arm.name, name, found, flush=True)
                continue
            tally = tallies.setdefault(f"{name}, jerk limited" if jerk else name, Tally())
            for kind, one in made.items():
                tally.count(arm, one, limits, found[kind], name)
            if arm.dof >= 6:
                mice.append(mouse_row(arm, name, jerk, made, found))


def mouse_row(
    arm: kinseek.Arm, who: str, jerk: bool, made: dict[str, Stream], found: dict[str, Tracked]
) -> Row:
    """How far one tracker is behind the mouse, and beyond the targets of jumps."""
    moving = len(made["mouse"].T) - periods(HOLD)
    behind = lag(arm.chain, found["mouse"].q[:moving], made["mouse"].T[:moving])
    return {
        "arm": arm.name,
        "jerk": f"{JERK:,.0f}" if jerk else "–",
        "who": who,
        ">mean mm": f"{1e3 * behind.mean:.3g}",
        ">largest mm": f"{1e3 * behind.largest:.3g}",
        ">behind ms": f"{1e3 * behind.behind:.0f}",
        ">off the shape mm": f"{1e3 * behind.shape:.3g}",
        ">overshoot mrad": f"{1e3 * overshoot(found['step'].q, made['step'].T):.3g}",
    }


def crowded(arm: kinseek.Arm) -> kinseek.Scene:
    """An arm of capsules among twenty boxes, all as large as its reach asks for."""
    size, rng = reach(arm), np.random.default_rng(0)
    scene = kinseek.Scene.of(arm, capsules=0.04 * size)
    centre = arm.chain.fixed[0][:3, 3]
    for number in range(BODIES):
        way = rng.normal(size=3)
        at = centre + rng.uniform(0.5, 1.1) * size * way / np.linalg.norm(way)
        scene.add(
            f"box{number}", Box(size * rng.uniform(0.05, 0.2, 3)), kinseek.pose(at, rpy=rng.uniform(-3, 3, 3))
        )
    return scene


def among_bodies(arm: kinseek.Arm, steps: int, faults: list[str]) -> Row:
    """A tracker in a scene, on streams that begin where it is free."""
    from .outside import Outside

    scene = crowded(arm)
    outside, tally, statuses = Outside(scene, arm), Tally(), Counter[str]()
    depths, times, seed, streams = [np.zeros(0)], [np.zeros(0)], 0, 0
    while tally.steps < steps:
        for kind in SCENE_STREAMS:
            made, limits = stream(arm, kind, seed), ALL_LIMITS[seed % 2]
            if not scene.free(made.q0):
                continue
            found = tracked(begun(arm, made.q0, limits, scene=scene).step, made.T)
            where = place_of(arm, kind, seed, limits) + ", scene"
            tally.count(arm, made, limits, found, where, aims=False)
            depths.append(outside.depths(found.q))
            if (depths[-1] > 0).any():
                first, number = int(np.argmax(depths[-1] > 0)), int((depths[-1] > 0).sum())
                faults.append(
                    f"{where}: {number} steps touch, the first {first}, at most {1e3 * depths[-1].max():.3g} mm"
                )
            times.append(found.times)
            statuses.update(found.statuses)
            streams += 1
        seed += 1
    faults += tally.faults
    depth, cost = np.concatenate(depths), np.concatenate(times)
    return {
        "arm": arm.name,
        ">streams": streams,
        ">steps": f"{tally.steps:,}",
        ">touching": int((depth > 0).sum()),
        ">deepest mm": f"{1e3 * depth.max():.3g}",
        **{f">{kind}": tally.violated[kind] for kind in KINDS},
        ">tracking": f"{statuses['TRACKING'] / tally.steps:.0%}",
        ">braking": f"{statuses['BRAKING'] / tally.steps:.0%}",
        ">median µs": f"{np.median(cost):.1f}",
        ">p99 µs": f"{np.percentile(cost, 99):.1f}",
    }


def costs(arm: kinseek.Arm) -> Row:
    """What a step costs behind the mouse, all trackers interleaved."""
    scene = crowded(arm)
    seed = next(k for k in range(1000) if scene.free(stream(arm, "mouse", k).q0))
    made = stream(arm, "mouse", seed)
    starts: dict[str, Callable[[], Any]] = {
        "velocity": lambda: begun(arm, made.q0, Limits(VELOCITY)),
        "acceleration": lambda: begun(arm, made.q0, ALL_LIMITS[0]),
        "jerk": lambda: begun(arm, made.q0, ALL_LIMITS[1]),
        "in a scene": lambda: begun(arm, made.q0, ALL_LIMITS[1], scene=scene),
        "ruckig behind": lambda: Behind(arm, made.q0, ALL_LIMITS[1], False),
    }
    trackers = {name: start() for name, start in starts.items()}
    times: dict[str, list[Array]] = {name: [] for name in starts}
    for chunk in range(ROUNDS):
        T = made.T[chunk * CHUNK : (chunk + 1) * CHUNK]
        for name, tracker in trackers.items():
            times[name].append(timed(tracker.step, T)[1])
    cells: Row = {"arm": arm.name}
    for name, each in times.items():
        cells[f">{name}"] = f"{np.median(each):.1f} / {np.percentile(each, 99):.1f}"
    return cells


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__, __doc__, arms=ARMS, page="streams.md", steps=(1_000_000, 100_000, "steps in all")
    )
    parser.add_argument("--peers", nargs="*", choices=PEERS, default=list(PEERS), help="names")
    options = parser.options()
    arms = [kinseek.load(name) for name in options.arms]
    page = Page("Streams", "benchmarks.streams", __doc__)
    each = [ours(arm, options.steps * 2 // 3 // len(arms)) for arm in arms]
    kinds = {kind: sum((tallies[kind] for tallies in each), Tally()) for kind in STREAMS}
    whole = sum(kinds.values(), Tally())
    page.head("Limits")
    page.say(
        "*position* to *jerk*: steps that violate this limit. *largest*: the largest share of the limit in any step.",
    )
    page.rows({"stream": kind} | tally.limits for kind, tally in [*kinds.items(), ("all", whole)])
    page.head("At rest")
    page.say(
        f"*after {SETTLED:g} s*: rests of a target during which the arm is at rest after that time. *reversals*: changes",
        "of direction of a joint after that time and after the arm has come to rest. *reached*: reachable targets from",
        f"which the hand is at most {REACHED:g} m and rad away after {HOLD:g} s; *the others*: status of the others.",
    )
    page.rows({"stream": kind} | tally.rests for kind, tally in [*kinds.items(), ("all", whole)])

    page.head("Beside other trackers")
    page.say(
        "The streams of one seed. Ruckig makes one step a period towards the joint values of a tracker that limits only",
        "velocities, and stands still if it finds no motion; in the second row its targets also have the velocities of",
        "that tracker. Limits of the peers:",
        f"{'; '.join(f'{peer} {limits}' for peer, limits in PEERS.items())}. Jerk counts only where it is limited.",
    )
    beside: dict[str, Tally] = {}
    mice: list[Row] = []
    for arm in arms:
        compared(arm, options.peers, beside, mice)
    page.rows(
        {"who": who} | tally.limits | tally.rests | {">no step": tally.stood} for who, tally in beside.items()
    )
    page.head("Lag")
    page.say(
        "Distances between hand and target while the hand follows the mouse: in the same period, and (*off the shape*) the",
        "largest one after the hand's path is shifted in time by *behind*, which makes their mean least. *overshoot*: how",
        "far a joint goes beyond its value at rest after jumps.",
    )
    page.rows(sorted(mice, key=lambda row: (row["arm"], row["jerk"])))

    page.head("In a scene")
    page.say(
        f"Capsules for the links among {BODIES} boxes; streams that begin where the arm is free, whatever is in their way.",
        "*touching*: steps with a contact, by MuJoCo.",
    )
    page.rows(among_bodies(arm, options.steps // 3 // len(arms), whole.faults) for arm in arms)
    page.head("Time of a step")
    page.say("While following the mouse, median / p99 [µs]; the trackers are measured alternately.")
    page.rows(costs(arm) for arm in arms)
    page.head("Faults")
    page.items(whole.faults[:SHOWN])
    if len(whole.faults) > SHOWN:
        page.say(f"And {len(whole.faults) - SHOWN} more.")
    page.note = releases(VERSIONS)
    page.end(options)


if __name__ == "__main__":
    main()
