"""What a search tells of itself: what it needs and what it finds. Refusals, tables and ``--help`` are made from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import ClassVar, Protocol

from kinseek.errors import InvalidProblem, InvalidSolver
from kinseek.kinds import PLAIN_KINDS
from kinseek.problem import Problem
from kinseek.robots.mechanism import no_axes

from .base import Solver


class Near(Enum):
    """What a search makes of `near`; the value is for people."""

    NEAREST = "finds the answer nearest to it"
    START = "needs it, to start there"
    TURN = "chooses full turns by it"


@dataclass(frozen=True)
class Traits:
    """What a search needs, and what may be expected of it."""

    source: str
    """Where it is from."""
    finds: str
    work: str
    """How much for one target."""
    near: Near
    """What `near` is to it. A search that needs it starts in the middle of every range without, and finds little."""
    axes: bool = False
    """Does it need axes and links? Else poses alone do, those of a function too."""
    plain_joints: bool = False
    """Does it need every joint to turn about an axis or to slide along one, those of a function too?"""
    ranges: bool = False
    """Does it take goals with free axes and ranges, of an arm with axes?"""
    made_of: bool = False
    """Is it made of other searches, and needs what they need?"""


class OwnSolver(Solver, Protocol):
    """A search of `ALL_SOLVERS`: it tells of itself."""

    traits: ClassVar[Traits]


def named(wanted: Callable[[Traits], bool]) -> list[str]:
    """Names of the searches whose traits are as wanted; those made of others come last and say so."""
    from . import ALL_SOLVERS

    own = [cls.__name__ for cls in ALL_SOLVERS if wanted(cls.traits) and not cls.traits.made_of]
    return own + [
        f"{cls.__name__} made of these" for cls in ALL_SOLVERS if cls.traits.made_of and len(own) > 1
    ]


def listed(wanted: Callable[[Traits], bool]) -> str:
    """The same as text."""
    names = named(wanted)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])}, and {names[-1]}"


def require(search: OwnSolver, problem: Problem) -> None:
    """Refuse an arm or a goal of which a search makes nothing, and say what works.

    Raises:
        InvalidSolver: The search needs axes, and the arm is a function.
        InvalidProblem: The search knows no free axes and ranges, and the goal has them.
    """
    name, traits = type(search).__name__, search.traits
    if traits.axes and problem.axes is None:
        why = no_axes(problem.mechanism, f"{name} needs the axes and links of an arm")
        raise InvalidSolver(f"{why}. What works on it: {listed(lambda each: not each.axes)}")
    form = problem.goal.form
    if form.ranges and not traits.ranges:
        raise InvalidProblem(
            f"{name} makes nothing of {form.noun}, only of {', '.join(kind.noun for kind in PLAIN_KINDS)}. "
            f"What takes it: {listed(lambda each: each.ranges)}"
        )


def table() -> str:
    """All searches and what may be expected of them, in Markdown."""
    from . import ALL_SOLVERS

    head = ("search", "from", "finds", "`near=`", "needs axes", "free axes, ranges", "work")
    rows = [_row(cls) for cls in ALL_SOLVERS]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows))


def summary(cls: type[OwnSolver]) -> str:
    """One line on a search for a command line's help: what it finds, and what it cannot do without."""
    traits = cls.traits
    lacks = [
        "needs --near" if traits.near is Near.START else "",
        "needs axes" if traits.axes else "",
        "takes --free" if traits.ranges else "",
    ]
    return "; ".join([traits.finds, *filter(None, lacks)])


def _row(cls: type[OwnSolver]) -> tuple[str, ...]:
    traits = cls.traits
    theirs = "as these do" if traits.made_of else ""
    return (
        f"`{cls.__name__}`",
        traits.source,
        traits.finds,
        traits.near.value,
        theirs
        or ("yes" if traits.axes else "no, but joints that turn or slide" if traits.plain_joints else "no"),
        theirs or ("yes, of an arm with axes" if traits.ranges else "no"),
        traits.work,
    )
