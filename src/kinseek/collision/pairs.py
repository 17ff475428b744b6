"""Pairs of bodies: which are checked, and why the others are not."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from kinseek.errors import InvalidRobot, InvalidScene
from kinseek.printable import printable
from kinseek.robots.srdf import Srdf, read_srdf

from .bodies import ArmBodies, Body

NEIGHBOURS = "neighbours: a joint connects them"
ATTACHED = "attached: it is carried by this link"
MAY_TOUCH = "allowed: it may touch this"
ALWAYS = "always: they touch at all of "
NOTHING_CHECKED = "no two bodies are checked, and so everything is free; Scene.pairs has the reasons"
"""A note on a scene of which no pair counts: the capsules of its links may be too thick."""


@dataclass(frozen=True, slots=True)
class Pair:
    """Two bodies, and whether they are checked for collision."""

    a: str
    b: str
    reason: str = ""
    """Why it is never checked; empty if it is."""

    @property
    def counts(self) -> bool:
        """Is it checked?"""
        return not self.reason

    def __str__(self) -> str:
        """A line for display."""
        return printable(f"{self.a} - {self.b}: {self.reason or 'checked'}")


@dataclass(frozen=True)
class Contact:
    """Two bodies that touch, or are closer than the clearance."""

    a: str
    b: str
    depth: float
    """Penetration depth [m]: the shortest motion of one body after which they only touch. Negative if they are apart, and
    closer than the clearance.
    """

    def __str__(self) -> str:
        """A phrase for display."""
        how = f"{self.depth * 1e3:.1f} mm deep" if self.depth >= 0 else f"{-self.depth * 1e3:.1f} mm apart"
        return printable(f"{self.a} and {self.b}, {how}")


def key(a: str, b: str) -> tuple[str, str]:
    """Return the two names of a pair in a fixed order."""
    return (a, b) if a <= b else (b, a)


def pairs_of(bodies: Iterable[Body], never: dict[tuple[str, str], str]) -> Iterator[Pair]:
    """Yield all pairs of bodies, in order; `never` gives the reasons of pairs that are not checked."""
    bodies = list(bodies)
    for i, a in enumerate(bodies):
        where = f"joint {a.frame.joints}" if a.frame.joints else "the base"
        together = f"neither moves against the other: {where} carries both"
        for b in bodies[i + 1 :]:
            reason = never.get(key(a.name, b.name), "")
            if a.frame.joints == b.frame.joints:
                reason = together
            yield Pair(a.name, b.name, reason)


def disabled_by(
    srdf: Srdf | str | Path | bytes, arm: ArmBodies, trusted: bool = True
) -> tuple[dict[tuple[str, str], str], list[str]]:
    """Return the pairs that an SRDF disables, with the reason, and notes.

    Args:
        srdf: The SRDF, its path, or its text.
        arm: The bodies of the arm.
        trusted: Whether Python may evaluate the expressions of a xacro file.

    Raises:
        InvalidScene: It cannot be read, or belongs to another robot.
    """
    try:
        srdf = srdf if isinstance(srdf, Srdf) else read_srdf(srdf, trusted=trusted)
    except InvalidRobot as error:
        raise InvalidScene(str(error)) from error
    found: dict[tuple[str, str], str] = {}
    bodies = [body.name for body in arm.bodies]
    for link in set(srdf.unchecked).intersection(bodies):
        found |= {key(link, other): "SRDF: disabled by default" for other in bodies if other != link}
    for a, b, _ in srdf.enabled:
        found.pop(key(a, b), None)
    named = set(srdf.unchecked)
    unknown = named - arm.links.keys()
    for a, b, reason in srdf.disabled:
        named |= {a, b}
        unknown |= {a, b} - arm.links.keys()
        found[key(a, b)] = f"SRDF: {reason or 'disabled'}"
    other = (srdf.robot or arm.robot) != arm.robot
    if unknown and (other or unknown == named):
        raise InvalidScene(
            f"{srdf.where}: this is the SRDF of robot {srdf.robot!r}, and the arm is of {arm.robot!r}, which has no link "
            f"{min(unknown)!r}"
        )
    notes = (
        [f"{srdf.where} names links that the file does not have: {', '.join(sorted(unknown))}"]
        if unknown
        else []
    )
    return found, notes
