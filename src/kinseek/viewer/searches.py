"""The searches that a page offers, and those of their parameters that can be set."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields

from kinseek.errors import InvalidSolver
from kinseek.solvers.base import Solver
from kinseek.solvers.every import ALL_SOLVERS
from kinseek.solvers.traits import Near, OwnSolver

SEARCHES: dict[str, type[OwnSolver]] = {cls.__name__: cls for cls in ALL_SOLVERS}
"""Searches by name; the first is the default."""

DEFAULT = next(iter(SEARCHES))

PARAMETERS = {
    "branching_factor": "B, nodes a joint",
    "divisions": "D, values in pass 1",
    "breadth": "Br, breadth",
    "tree": "tree",
    "beam": "K, cells kept",
}
"""Fields of searches that a page shows, and their labels."""

HINTS = {
    "branching_factor": "Nodes a joint; the last pass has a spacing of one node.",
    "divisions": "Values a joint in the first pass; each later pass divides the spacing by D.",
    "breadth": "A number is the paper's constant breadth, a fraction a mean over the passes; one a joint with commas, "
    "or tuned, its breadth tuning; or reach.",
    "tree": "static makes all nodes first; dynamic makes them when needed. The solutions have the same bits.",
    "beam": "Cells that a pass leaves to the next; the paper has 1.",
}

TREES = ("dynamic", "static")


def parameters_of(search: str) -> dict[str, str]:
    """Return the parameters of a search that a page shows, by name, with their defaults as text."""
    own = {each.name: each.default for each in fields(SEARCHES[search])}  # type: ignore[arg-type]
    return {name: str(own[name]) for name in PARAMETERS if name in own}


def takes_seconds(search: str) -> bool:
    """Return whether a search may take long and needs a time limit."""
    return search != DEFAULT


def needs_start(search: str) -> bool:
    """Return whether a search starts at the pose shown, and finds little from elsewhere."""
    return SEARCHES[search].traits.near is Near.START


MOST_FACTOR = 100_000
"""Maximum number of nodes per joint: a static tree needs some hundred bytes for each, and any page can request one."""


def make_search(search: str, given: Mapping[str, str]) -> Solver | None:
    """Build a search; None for the default, which the arm provides.

    Args:
        search: Its name.
        given: Parameters as text.

    Raises:
        InvalidSolver: A parameter that cannot be read, or is out of its range.
    """
    own = parameters_of(search)
    values = {name: _read(name, text) for name, text in given.items() if name in own}
    return None if search == DEFAULT else SEARCHES[search](**values)


def _read(name: str, text: str) -> object:
    """Read a parameter from text: a number, numbers with commas, or a word."""
    words = ("tuned", "reach") if name == "breadth" else TREES if name == "tree" else ()
    if text.strip() in words:
        return text.strip()
    try:
        numbers = tuple(map(float if name == "breadth" else int, text.split(",")))
    except ValueError:
        numbers = ()
    if name == "branching_factor" and max(numbers, default=0) > MOST_FACTOR:
        raise InvalidSolver(
            f"{PARAMETERS[name]}: the page takes at most {MOST_FACTOR:,}, got {max(numbers):,}"
        )
    if name != "tree" and (len(numbers) == 1 or (numbers and name == "breadth")):
        return numbers[0] if len(numbers) == 1 else numbers
    takes = ["a whole number"] if name not in ("tree", "breadth") else []
    takes += ["a number", "one a joint with commas"] if name == "breadth" else []
    raise InvalidSolver(f"{PARAMETERS[name]}: expected {', or '.join([*takes, *words])}; got {text!r}")
