"""The collision engine of a scene's bodies, and its results at random joint values."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from kinseek.errors import InvalidScene
from kinseek.robots.chain import SerialChain
from kinseek.support.lazy import Lazy, lazy

from .bodies import Body
from .engine import Engine, Solid, joints_of
from .motion import Speeds
from .pairs import ALWAYS, Pair, key
from .shapes import measures_of

MOST_PAIRS = 200_000
"""Maximum number of checked pairs of shapes: each takes some 6 kB."""

MOST_TOUCHES = 1_000_000
"""Maximum number of random joint values, for each pair, at which pairs of links touch: each takes some 30 µs."""


@dataclass(frozen=True)
class Assembly(Lazy):
    """The engine of a scene, and the body of each part."""

    chain: SerialChain
    engine: Engine
    owners: list[tuple[str, str]]
    """Names of the two bodies of each pair of parts."""
    numbers: dict[str, list[int]]
    """Numbers of the parts of each body."""
    both: dict[str, Speeds] = field(default_factory=dict)
    """The pairs with another arm that moves at the same time, by its name, if they were needed."""

    @lazy
    def speeds(self) -> Speeds:
        """Bounds on the speeds of bodies."""
        return Speeds(self.chain, self.engine)

    def stand(self, bodies: Iterable[Body]) -> None:
        """Update the poses of bodies fixed in the base, without rebuilding the engine."""
        poses = {
            number: body.frame.pose @ part.pose
            for body in bodies
            for number, part in zip(self.numbers.get(body.name, ()), body.parts, strict=False)
        }
        with self.engine.lock:
            try:
                self.engine.stand(poses)
            except BaseException:
                # Ctrl-C came between two bodies. Questions of other threads may use this engine.
                self.engine.stand(poses)
                raise


def assemble(
    chain: SerialChain, bodies: Iterable[Body], pairs: Iterable[Pair], joints: tuple[Any, Any] | None = None
) -> Assembly:
    """Build the engine of the checked pairs, with the bodies that occur in one; `joints` are those of `Engine`.

    Raises:
        InvalidScene: Too many pairs of shapes.
    """
    solids: list[Solid] = []
    numbers: dict[str, list[int]] = {}
    counting = [pair for pair in pairs if pair.counts]
    named = {name for pair in counting for name in (pair.a, pair.b)}
    for body in (body for body in bodies if body.name in named):
        numbers[body.name] = list(range(len(solids), len(solids) + len(body.parts)))
        solids += [
            Solid(body.frame.joints, part.shape, body.frame.pose @ part.pose, body.padding)
            for part in body.parts
        ]
    _require_few_pairs(sum(len(numbers[pair.a]) * len(numbers[pair.b]) for pair in counting))
    counted = [
        ((i, j), (pair.a, pair.b)) for pair in counting for i in numbers[pair.a] for j in numbers[pair.b]
    ]
    engine = Engine(chain, solids, [pair for pair, _ in counted], joints)
    return Assembly(chain, engine, [names for _, names in counted], numbers)


def _require_few_pairs(total: int) -> None:
    """Raise an error for too many pairs of shapes."""
    if total > MOST_PAIRS:
        raise InvalidScene(
            f"{total:,} pairs of shapes have to be checked, expected at most {MOST_PAIRS:,}: give bodies fewer "
            "shapes, e.g. one mesh instead of several, or exclude pairs with allow()"
        )


def digest(bodies: Iterable[Body], pairs: Iterable[Pair]) -> str:
    """Return a digest of everything that results depend on: shapes, poses, padding, and checked pairs."""
    sha = hashlib.sha256()
    for body in bodies:
        sha.update(f"{body.name!r} {body.frame.joints} {body.padding!r}".encode())
        for part in body.parts:
            sha.update(type(part.shape).__name__.encode())
            sha.update(np.ascontiguousarray(body.frame.pose @ part.pose).tobytes())
            for numbers in measures_of(part.shape):
                sha.update(numbers.tobytes())
    for pair in pairs:
        sha.update(f"{pair.a!r} {pair.b!r} {pair.counts}".encode())
    return sha.hexdigest()[:16]


def sampled(
    chain: SerialChain, bodies: Iterable[Body], pairs: Iterable[Pair], samples: int, skip_never: bool
) -> dict[tuple[str, str], str]:
    """Return the pairs that touch at all random joint values, or with `skip_never` at none of them, with the reason.

    Raises:
        InvalidScene: Too many pairs, or so many touch at all of them that finding this takes long.
    """
    bodies, pairs, found = list(bodies), list(pairs), dict[tuple[str, str], str]()
    _require_few_pairs(len(pairs))  # Each body has a shape at least.
    q = np.random.default_rng(0).uniform(chain.lower, chain.upper, (samples, chain.dof))
    joints, touched = joints_of(chain), 0
    for pair in pairs:
        engine = assemble(chain, bodies, [pair], joints).engine
        never = False
        if skip_never:
            free = engine.exactly_free(q, 0.0)
            always, never = not free.any(), bool(free.all())
        else:  # The first sample without contact ends it.
            always = not any(engine.exactly_free(one[None], 0.0)[0] for one in q)
            touched += samples * always
            if touched > MOST_TOUCHES:
                raise InvalidScene(
                    f"more than {MOST_TOUCHES // samples:,} pairs of links touch at all of {samples:,} random joint values: "
                    "are the shapes of the links too large, or in other units than metres?"
                )
        if always:
            found[key(pair.a, pair.b)] = f"{ALWAYS}{samples:,} random joint values"
        elif never:
            found[key(pair.a, pair.b)] = f"never: they touch at none of {samples:,} random joint values"
    return found
