"""Selection of traces, passes and joints for pictures, with error messages for those that cannot be shown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidUse
from kinseek.solution import Solution
from kinseek.support.validation import as_integer
from kinseek.trace import Pass, Trace

from .figures import text_of

Array = NDArray[np.float64]


def trace_of(traced: Trace | Solution) -> Trace:
    """Return the trace of one target.

    Raises:
        InvalidUse: A batch, something else, or no trace.
    """
    trace = traced.trace if isinstance(traced, Solution) else traced
    if isinstance(trace, np.ndarray):
        raise InvalidUse(
            f"a picture shows one search, got a batch of shape {trace.shape}; choose one: solution[0]"
        )
    if not isinstance(trace, Trace):
        raise InvalidUse(f"expected a trace, or a solution with a trace, got {type(traced).__name__}")
    return trace


def judged(solution: Solution) -> Solution:
    """Return a solution, which defines the error of any joint values; a trace alone does not.

    Raises:
        InvalidUse: Something else.
    """
    if isinstance(solution, Trace):
        raise InvalidUse("this picture needs the goal, which a trace does not contain; give the solution")
    if not isinstance(solution, Solution):
        raise InvalidUse(f"expected a solution of arm.ik, got {type(solution).__name__}")
    if solution.problem.goal.shape:
        shape = solution.problem.goal.shape
        raise InvalidUse(f"a picture shows one search, got a batch of shape {shape}; choose one: solution[0]")
    return solution


def named(traces: Mapping[str, Trace | Solution] | Sequence[Trace | Solution]) -> dict[str, Trace]:
    """Return traces by name; without names, by the names of their searches."""
    if isinstance(traces, Mapping):
        named = {name: trace_of(each) for name, each in traces.items()}
    else:
        named = {}
        for each in map(trace_of, [traces] if isinstance(traces, Trace | Solution) else traces):
            again = sum(name.partition(" (")[0] == each.search for name in named)
            named[f"{each.search} ({again + 1})" if again else each.search] = each
    if not named:
        raise InvalidUse("a picture needs at least one trace, got none")
    return named


def joint_of(names: Sequence[str], joint: int | str) -> int:
    """Return the index of a joint, from 0."""
    if not isinstance(joint, str):
        return as_integer("a joint, unless it is a name,", joint, 0, len(names) - 1, InvalidUse)
    if joint not in names:
        raise InvalidUse(f"there is no joint {joint!r}; valid: {', '.join(names)}")
    return list(names).index(joint)


def turning(trace: Trace, joint: int | str) -> int:
    """Return the index of a revolute joint, from 0."""
    names, d = trace.joint_names, joint_of(trace.joint_names, joint)
    if trace.kinds[d] not in ("revolute", "continuous"):
        raise InvalidUse(f"joint {names[d]!r} is {trace.kinds[d]}: it does not turn in a circle")
    return d


def pass_of(trace: Trace, number: int) -> Pass:
    """Return a pass by its number, from 1."""
    return trace[as_integer("number, that of a pass of this search,", number, 1, len(trace), InvalidUse) - 1]


def with_windows(trace: Trace) -> list[Pass]:
    """Return the passes that have a window.

    Raises:
        InvalidUse: None has.
    """
    shown = [each for each in trace if each.counts is not None]
    if not shown:
        raise InvalidUse(f"no pass of this {trace.search} has a window; use DivideAndConquer or BruteForce")
    return shown


def two_joints(names: Sequence[str], joints: object) -> tuple[int, int]:
    """Return the indices of two different joints, from 0."""
    if not isinstance(joints, Sequence) or isinstance(joints, str) or len(joints) != 2:
        raise InvalidUse(f"joints must be two, by number or by name; got {joints!r}")
    x, y = (joint_of(names, joint) for joint in joints)
    if x == y:
        raise InvalidUse(f"joints must be two different ones, got {joints!r}")
    return x, y


def count_of(name: str, value: int, least: int) -> int:
    """Return an integer of at least `least`."""
    return as_integer(name, value, least, error=InvalidUse)


UNITS = {"prismatic": "m", "number": ""}
"""Units of joint values by kind of joint; all others are in radians."""


def unit_of(kind: str) -> str:
    """Return the unit of a joint's values, "" for a plain number."""
    return UNITS.get(kind, "rad")


def axis_label(name: str, kind: str) -> str:
    """Return the label of an axis with a joint's values."""
    unit, name = unit_of(kind), text_of(name)
    return f"{name} [{unit}]" if unit else name
