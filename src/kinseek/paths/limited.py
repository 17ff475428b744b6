"""The joints of a tracker, which follow joint values or velocities within limits, and can always stop in time."""

from __future__ import annotations

from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.paths.limited import (
    ACCELERATION,
    FOLLOW,
    FREE,
    GO,
    JERK,
    POSITION,
    STRAIGHT,
    VELOCITY,
    Motion,
    Room,
    limited_step,
)
from kinseek.timing.obstacles import Obstacles

Array = NDArray[np.float64]

KINDS = {POSITION: "position", VELOCITY: "velocity", ACCELERATION: "acceleration", JERK: "jerk"}
"""Names of limits."""

RESERVE = 1e-3
"""Distance beyond the clearance that is left for leaving: bounds of a motion do not know where it leads, and without it the
joints could not move any more [m]. Not examined further."""

ALONG = 1e-7
"""A motion that reduces a distance by less leads along a body [m]."""

CLOSE = 0.04
"""If bodies were closer to each other when their distance was last measured, the joints go straight [m]. Not examined
further."""

WORN = 1e-4
"""How far motions along a body use the reserve up in all, until bodies are farther apart again [m]."""

FEW = 3
"""Distances that are measured in a step before those of all other pairs are bounded again. Not examined further."""


class Rates(NamedTuple):
    """Limits of joints, (n,) each; infinite if there is none."""

    velocity: Array
    acceleration: Array
    jerk: Array


class Margins(Protocol):
    """What is needed of a scene; see `collision.margins.Margins`."""

    def levers(self, low: Array, high: Array) -> Array:
        """See `Margins.levers`."""

    def distances(self, q: Array) -> Array:
        """See `Margins.distances`."""

    def distance(self, q: Array, pair: int) -> float:
        """See `Margins.distance`."""

    def names(self, pair: int) -> tuple[str, str]:
        """See `Margins.names`."""


class Surroundings(Obstacles, Protocol):
    """What is needed of a scene."""

    @property
    def margins(self) -> Margins:
        """See `Scene.margins`."""


class Around(NamedTuple):
    """What must not be touched."""

    scene: Surroundings | None = None
    clearance: float = 0.0
    """Least distance of bodies [m]."""


NOTHING = Around()


class Restriction(NamedTuple):
    """What kept the joints from what was desired in a step."""

    joint: int = -1
    """The joint that is farthest from it; -1 for none."""
    limit: int = FREE
    """Its limit, see `KINDS`."""
    pair: int = -1
    """Pair of bodies that may touch soon; -1 for none."""


class LimitedJoints:
    """Joints within limits, and their state."""

    def __init__(
        self, lower: Array, upper: Array, rates: Rates, q: Array, own: slice, around: Around = NOTHING
    ) -> None:
        """Start at rest.

        Args:
            lower: Limits of the joints, (n,).
            upper: (n,)
            rates: Limits of their velocities, accelerations and jerks.
            q: Joint values, (n,).
            own: The joints of the scene's arm among all.
            around: The scene.
        """
        n = len(q)
        self.state = np.zeros((3, n))
        """Joint values, velocities and accelerations, (3, n)."""
        self.state[0] = q
        before, after = (lower, upper, *rates), (q, q, *np.zeros((6, n)))
        self.motion = Motion(
            *(np.array(row, dtype=np.float64) for row in before),
            *self.state,
            *(np.array(row, dtype=np.float64) for row in after),
        )
        self._own, self._around = own, around
        self._margins: Margins | None = None
        self._exact: dict[int, float] = {}
        """Distances of pairs when they were last measured."""
        self._entered: dict[int, float] = {}
        """Those of pairs in the reserve, when the joints began to use it."""
        self.room = Room(np.zeros((0, n)), np.zeros(0))

    def __getstate__(self) -> dict[str, Any]:
        """Leave the distances of the scene out of pickles and copies: the next step measures them again."""
        return {**vars(self), "_margins": None}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Let the motion refer to the state again, of which pickles and copies make separate arrays."""
        vars(self).update(state)
        q, velocity, acceleration = self.state
        self.motion = self.motion._replace(q=q, velocity=velocity, acceleration=acceleration)

    def follow(self, q: Array, h: float) -> Restriction:
        """Move towards joint values, (n,), for the time h."""
        self.motion.target[:] = q
        return self._step(h, FOLLOW)

    def go(self, velocity: Array, h: float) -> Restriction:
        """Change to velocities, (n,), for the time h."""
        self.motion.wanted[:] = velocity
        return self._step(h, GO)

    def alone(self) -> LimitedJoints:
        """Return these joints without the scene, to see where they are going to be."""
        now = self.motion
        rates = Rates(now.velocity_limit, now.acceleration_limit, now.jerk_limit)
        found = LimitedJoints(now.lower, now.upper, rates, now.q, self._own)
        for row, mine in zip(found.motion, now, strict=True):
            row[:] = mine
        return found

    def restart(self) -> None:
        """Forget the target that was followed."""
        self.motion.before[:] = self.motion.q
        self.motion.rate[:] = 0.0

    def _step(self, h: float, what: int) -> Restriction:
        self.look()
        restriction = Restriction(*limited_step(self.motion, self.room, h, what, False))
        return restriction if restriction.pair < 0 else self.with_room(restriction, h, what)

    def with_room(self, restriction: Restriction, h: float, what: int = FOLLOW) -> Restriction:
        """Make a step that the distances known so far do not allow: with those at the present joint values."""
        scene, room = self._margins, self.room
        assert scene is not None
        exact, keep = self._exact, self._around.clearance + RESERVE
        granted, asked = set[int](), set[int]()
        measured = 0
        while (pair := restriction.pair) >= 0:
            if what == FOLLOW and exact.get(pair, np.inf) < keep + CLOSE:
                what = STRAIGHT
            elif pair not in granted and room.distance[pair] != exact.get(pair, np.inf) - keep:
                # Joints have moved since it was measured.
                if measured == FEW:
                    self._measure(scene)
                self._measure_pair(scene, pair, keep)
                measured += 1
            elif what == FOLLOW:
                what = STRAIGHT
            elif pair not in asked and self._leads_apart(scene, pair):
                # Where the joints lead bodies apart, or along each other, the reserve is theirs.
                asked.add(pair)
                granted.add(pair)
                room.distance[pair] += RESERVE
            elif pair in granted and exact[pair] >= keep + RESERVE:
                # It is not enough for what is desired, and the joints can move without it.
                granted.remove(pair)
                room.distance[pair] -= RESERVE
            else:
                # Others whose bounds leave too little room would keep the joints where they are.
                short = room.distance < room.levers @ self.motion.extent
                for other in np.flatnonzero(short).tolist():
                    if other in granted:
                        continue
                    if room.distance[other] != exact.get(other, np.inf) - keep:
                        self._measure_pair(scene, other, keep)
                    if exact[other] < keep + RESERVE and self._leads_apart(scene, other):
                        granted.add(other)
                        room.distance[other] += RESERVE
                restriction = Restriction(*limited_step(self.motion, room, h, what, True))
                break
            restriction = Restriction(*limited_step(self.motion, room, h, what, False))
        room.distance[[*granted]] -= RESERVE
        return restriction

    def _measure_pair(self, scene: Margins, pair: int, keep: float) -> None:
        """Measure the distance of a pair, of which the joints may use what is more than `keep` [m]."""
        self._exact[pair] = distance = scene.distance(self.motion.q[self._own], pair)
        self.room.distance[pair] = distance - keep
        if distance >= keep:
            self._entered.pop(pair, None)

    def _leads_apart(self, scene: Margins, pair: int) -> bool:
        """Return whether two bodies are not closer where what is desired comes to rest."""
        distance = self._exact[pair]
        least = max(distance - ALONG, self._entered.setdefault(pair, distance) - WORN)
        return scene.distance(self.motion.rest[self._own], pair) >= least

    def look(self) -> None:
        """Take notice of bodies that were added, removed or moved."""
        if self._around.scene is None or (scene := self._around.scene.margins) is self._margins:
            return
        low, high, q = (values[self._own] for values in (self.motion.lower, self.motion.upper, self.motion.q))
        own = scene.levers(np.minimum(low, q), np.maximum(high, q))  # They may be outside of their limits.
        levers = np.zeros((len(own), len(self.motion.q)))
        levers[:, self._own] = own
        self.room = Room(levers, np.full(len(levers), -np.inf))
        self._exact.clear()
        self._entered.clear()
        self._measure(scene)
        self._margins = scene  # Last: what interrupts this call leaves it to the next one.

    def _measure(self, scene: Margins) -> None:
        """Improve the bounds of all distances that are not exact."""
        bounds = scene.distances(self.motion.q[self._own]) - self._around.clearance - RESERVE
        np.maximum(self.room.distance, bounds, out=self.room.distance)

    def obstacle(self, pair: int) -> tuple[str, str, float]:
        """Return the names of two bodies and a lower bound of their distance [m]."""
        assert self._margins is not None
        return *self._margins.names(pair), float(self.room.distance[pair] + self._around.clearance + RESERVE)


class StraightWay:
    """A motion from joint values to others, from rest to rest, in which all joints keep a common proportion."""

    def __init__(self, start: Array, rates: Rates) -> None:
        """Begin at joint values, (n,), with the limits of the joints."""
        self._start, self._rates = start, rates
        none = Rates(*np.full((3, 1), np.inf))
        self._part = LimitedJoints(np.zeros(1), np.ones(1), none, np.zeros(1), slice(0, 1))
        self._part.motion.before[:] = 1.0

    def step(self, to: Array, h: float) -> Array:
        """Return the joint values after a step of duration h; `to` are the last ones, (n,), which may move."""
        whole, part = to - self._start, self._part.motion
        moving = np.abs(whole) > 0.0
        for limit, known in zip(
            (part.velocity_limit, part.acceleration_limit, part.jerk_limit), self._rates, strict=True
        ):
            # A little less, so that rounding makes no joint faster than its limit.
            limit[:] = (1.0 - 1e-9) * np.min(known[moving] / np.abs(whole[moving]), initial=np.inf)
        self._part.follow(np.ones(1), h)
        return to.copy() if part.q[0] >= 1.0 - 1e-12 else self._start + part.q[0] * whole


def straight_way(start: Array, to: Array, rates: Rates, period: float, most: int) -> Array | None:
    """Return the joint values of the straight way to others, one a period, (k, n); None if it takes more than `most`."""
    way, rows = StraightWay(start, rates), [start][:0]
    while not rows or (rows[-1] != to).any():
        if len(rows) >= most:
            return None
        rows.append(way.step(to, period))
    return np.array(rows)
