"""Every error kinseek raises.

    KinseekError
    ├── InvalidRobot(ValueError)     the arm: file, links, joints, limits
    │   └── FailedKinematics         a function given to Arm.from_fk raises, or gives no pose; carries the q
    ├── InvalidGoal(ValueError)      the target: pose, tolerances, weights
    ├── InvalidProblem(ValueError)   the call: joint vectors, start, budget
    ├── InvalidSolver(ValueError)    the search's own parameters
    ├── InvalidExport(ValueError)    what a controller is given: target, folder, memory
    ├── InvalidScene(ValueError)     what an arm may hit: shapes, bodies, pairs, files of geometry
    ├── InvalidMap(ValueError)       a map of the workspace: grid, store, workers
    ├── InvalidUse(TypeError)         a result is used as what it is not: a solution as a truth value
    ├── MissingExtra(ImportError)    an optional dependency is not installed
    ├── PathInterrupted(RuntimeError) an iterator of poses raised; carries the path through those before
    ├── MapInterrupted(RuntimeError) the making of a map ended early; what is done stays in its store
    ├── InternalError(AssertionError) kinseek contradicts itself: a fault of kinseek, to be reported
    └── NotReached(RuntimeError)     raised only by require(); carries the solution, or the path

Missing a tolerance is a status of the solution, never an exception.

Two warnings: `UnitWarning(UserWarning)`, a number is taken as it is, and another unit would explain it better; and
`RepairWarning(UserWarning)`, a matrix that was no rotation was brought onto one, because that was asked for.
"""

from __future__ import annotations

import difflib
import heapq
from collections.abc import Iterable
from typing import Any

from .printable import printable

_LONGEST, _COMPARED = 100, 200
"""Letters of a name that others are suggested for, and names that it is compared with, at most."""


class _OneLine:
    """A message that names things of files: it is one line, and its characters do nothing to a terminal."""

    def __str__(self) -> str:
        """The message, with escapes for what is not printable."""
        return printable(super().__str__().replace("\r\n", " ").replace("\n", " "))


class KinseekError(_OneLine, Exception):
    """The base of every error of this package."""


class InvalidRobot(KinseekError, ValueError):
    """The description of an arm cannot be used; the message says which part, and what would be valid."""


class FailedKinematics(InvalidRobot):
    """A function given as forward kinematics raises, or gives something that is no pose; the cause is chained."""

    def __init__(self, message: str, q: Any) -> None:
        """Carry the joint values that did it."""
        super().__init__(message)
        self.q = q
        """(n,)"""

    def __reduce__(self) -> tuple[type[FailedKinematics], tuple[str, Any]]:
        """Pickle with the joint values."""
        return type(self), (str(self), self.q)


class InvalidGoal(KinseekError, ValueError):
    """The target, a tolerance or a weight cannot be used."""


class InvalidProblem(KinseekError, ValueError):
    """A joint vector, start or budget does not fit the arm."""


class InvalidSolver(KinseekError, ValueError):
    """A parameter of a search is out of its range, or the search would not fit into memory."""


class InvalidExport(KinseekError, ValueError):
    """An arm cannot be written for a controller so: target, form, folder, or more memory than there is."""


class InvalidScene(KinseekError, ValueError):
    """What an arm may hit cannot be used: a shape, a body, a pair of them, a file with geometry."""


class InvalidMap(KinseekError, ValueError):
    """A map of the workspace cannot be made so: the grid, the store, or a worker with another version."""


class InvalidUse(KinseekError, TypeError):
    """A result is used as what it is not: a solution as a truth value, the answer to one target as a sequence."""


class MissingExtra(KinseekError, ImportError):
    """A feature needs an optional dependency; the message says how to install it."""

    def __init__(self, feature: str, extra: str) -> None:
        """Name the feature and the extra that brings it."""
        super().__init__(f"{feature} needs an optional dependency: pip install 'kinseek[{extra}]'")
        self.extra = extra


class PathInterrupted(KinseekError, RuntimeError):
    """The iterator that gave the poses of a path raised; its error is chained."""

    def __init__(self, message: str, path: Any) -> None:
        """Carry the path through the poses that came before, so that nothing found is lost."""
        super().__init__(message)
        self.path = path

    def __reduce__(self) -> tuple[type[PathInterrupted], tuple[str, Any]]:
        """Pickle with the path."""
        return type(self), (str(self), self.path)


class MapInterrupted(KinseekError, RuntimeError):
    """The making of a map ended early: workers or scheduler gone, disk full. What is done stays; the same call goes on."""

    def __init__(self, message: str, done: int, blocks: int) -> None:
        """Carry how many of the blocks are done."""
        super().__init__(message)
        self.done, self.blocks = done, blocks

    def __reduce__(self) -> tuple[type[MapInterrupted], tuple[str, int, int]]:
        """Pickle with the numbers."""
        return type(self), (str(self), self.done, self.blocks)


class InternalError(KinseekError, AssertionError):
    """Two results of kinseek contradict each other: a fault of kinseek, never of the call.

    The message holds what a report needs. Do not rely on any result of the call.
    """


class NotReached(KinseekError, RuntimeError):
    """An answer misses a tolerance and the caller asked to be told by an exception."""

    def __init__(self, message: str, solution: Any) -> None:
        """Carry the whole solution, so that nothing found is lost."""
        super().__init__(message)
        self.solution = solution

    def __reduce__(self) -> tuple[type[NotReached], tuple[str, Any]]:
        """Pickle with the solution, so that worker processes may raise it."""
        return type(self), (str(self), self.solution)


class UnitWarning(_OneLine, UserWarning):
    """An angle beyond a full turn or a length far beyond the arm: degrees or millimetres, perhaps."""


class RepairWarning(_OneLine, UserWarning):
    """A rounded matrix was brought onto the nearest rotation; the message tells how far it was from one."""


def suggest(got: str, valid: Iterable[str], noun: str) -> str:
    """Return ``unknown <noun> 'got'``, the near matches and the valid choices, as one sentence."""
    choices = sorted(valid)
    said = unknown(got, choices, noun)
    end = "" if said.endswith("?") else "."
    return f"{said}{end} Valid: {', '.join(map(printable, choices)) or 'none'}"


def unknown(got: str, valid: Iterable[str], noun: str) -> str:
    """Return ``unknown <noun> 'got'`` and the near matches, without the valid choices."""
    near = near_names(got, valid)
    return f"unknown {noun} {got!r}" + (f"; did you mean {' or '.join(map(repr, near))}?" if near else "")


def near_names(got: str, valid: Iterable[str]) -> list[str]:
    """Return up to three names that look like a misspelt one, the most similar first.

    Names come from files: `difflib` needs up to a millisecond for two names of 100 letters, and the time grows faster than
    the square of their length. So longer names are left out, and only the names of the most similar lengths are compared.
    """
    if len(got) > _LONGEST:
        return []
    names = [name for name in valid if len(name) <= _LONGEST]
    folded = got.casefold()  # A name in other letters, UR5e for ur5e, is the nearest of all.
    if same := sorted(name for name in names if name.casefold() == folded):
        return same[:3]
    few = heapq.nsmallest(_COMPARED, names, key=lambda name: abs(len(name) - len(got)))
    return difflib.get_close_matches(got, few, n=3, cutoff=0.5)
