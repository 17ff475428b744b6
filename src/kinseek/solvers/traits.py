"""Properties of a search: what it needs and what it finds. Error messages, tables and ``--help`` are generated from them."""

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
    """How a search uses `near`; the value is for display."""

    NEAREST = "returns the nearest of the solutions that it finds"
    START = "starts there; without it, starts in the middle of the ranges"
    TURN = "uses it to choose full turns"


@dataclass(frozen=True)
class Traits:
    """Requirements of a search, and what can be expected of it."""

    source: str
    """Source of the search."""
    finds: str
    work: str
    """Amount of work for one target."""
    near: Near
    """Role of `near`. A search that starts there seldom finds a solution without it."""
    axes: bool = False
    """Whether it needs axes and links. Otherwise poses suffice, also those of black-box kinematics."""
    plain_joints: bool = False
    """Whether every joint, also of black-box kinematics, must rotate about an axis or slide along one."""
    ranges: bool = False
    """Whether it supports goals with free axes and ranges, for an arm with axes."""
    made_of: bool = False
    """Whether it consists of other searches and has their requirements."""


class OwnSolver(Solver, Protocol):
    """A search of `ALL_SOLVERS`: it has traits."""

    traits: ClassVar[Traits]


def named(condition: Callable[[Traits], bool]) -> list[str]:
    """Return the names of the searches with requested traits; composed searches come last and are marked."""
    from .every import ALL_SOLVERS

    own = [cls.__name__ for cls in ALL_SOLVERS if condition(cls.traits) and not cls.traits.made_of]
    return own + [
        f"{cls.__name__} made of these" for cls in ALL_SOLVERS if cls.traits.made_of and len(own) > 1
    ]


def listed(condition: Callable[[Traits], bool]) -> str:
    """Return the same as text."""
    names = named(condition)
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])}, and {names[-1]}"


def require(search: OwnSolver, problem: Problem) -> None:
    """Reject an arm or a goal that a search does not support, and name alternatives.

    Raises:
        InvalidSolver: The search needs axes, and the arm has black-box kinematics.
        InvalidProblem: The search does not support free axes and ranges, and the goal has them.
    """
    name, traits = type(search).__name__, search.traits
    if traits.axes and problem.axes is None:
        why = no_axes(problem.mechanism, f"{name} needs the axes and links of an arm")
        raise InvalidSolver(f"{why}. Searches that support it: {listed(lambda each: not each.axes)}")
    form = problem.goal.form
    if form.ranges and not traits.ranges:
        raise InvalidProblem(
            f"{name} does not support {form.noun}; supported: {', '.join(kind.noun for kind in PLAIN_KINDS)}. "
            f"Searches that support it: {listed(lambda each: each.ranges)}"
        )


def table() -> str:
    """Return all searches and their traits as a Markdown table."""
    from .every import ALL_SOLVERS

    head = ("search", "from", "finds", "`near=`", "needs axes", "free axes, ranges", "work")
    rows = [_row(cls) for cls in ALL_SOLVERS]
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, ("---",) * len(head), *rows))


def summary(cls: type[OwnSolver]) -> str:
    """Return one line about a search for a command line's help: what it finds, and what it requires."""
    traits = cls.traits
    conditions = [
        "starts at --near" if traits.near is Near.START else "",
        "needs axes" if traits.axes else "",
        "takes --free" if traits.ranges else "",
    ]
    return "; ".join([traits.finds, *filter(None, conditions)])


def _row(cls: type[OwnSolver]) -> tuple[str, ...]:
    traits = cls.traits
    theirs = "like its two searches" if traits.made_of else ""
    return (
        f"`{cls.__name__}`",
        traits.source,
        traits.finds,
        traits.near.value,
        theirs
        or (
            "yes"
            if traits.axes
            else "no, but every joint must turn or slide"
            if traits.plain_joints
            else "no"
        ),
        theirs or ("yes, for an arm with axes" if traits.ranges else "no"),
        traits.work,
    )
