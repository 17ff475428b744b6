"""Every error kinseek raises.

    KinseekError
    ├── InvalidRobot(ValueError)     the arm: file, links, joints, limits
    │   └── FailedKinematics         a function given to Arm.from_fk raises or returns no pose; carries q
    ├── InvalidGoal(ValueError)      the target: pose, tolerances, weights
    ├── InvalidProblem(ValueError)   the call: joint vectors, start, budget
    ├── InvalidSolver(ValueError)    the search's own parameters
    ├── InvalidExport(ValueError)    the export for a controller: target, folder, memory
    ├── InvalidScene(ValueError)     a collision scene: shapes, bodies, pairs, files of geometry
    ├── InvalidMap(ValueError)       a map of the workspace: grid, store, workers
    ├── InvalidUse(TypeError)        an argument that a call does not have, or a result as a truth value
    ├── MissingExtra(ImportError)    an optional dependency is not installed
    ├── PathInterrupted(RuntimeError) an iterator of poses raised; carries the path through the poses before
    ├── MapInterrupted(RuntimeError) the making of a map ended early; finished blocks stay in its store
    ├── InternalError(AssertionError) kinseek contradicts itself: a bug in kinseek, please report it
    └── NotReached(RuntimeError)     a missed goal: require(), timed(), move(), plan(); carries the solution or path

A missed tolerance is reported as a status of the solution; no exception is raised.

Three warnings: `UnitWarning(UserWarning)`, a number is probably in another unit, but is used unchanged;
`RepairWarning(UserWarning)`, a matrix that was not a rotation was replaced by the nearest one, as the caller requested; and
`LimitWarning(UserWarning)`, a file of limits allows more than the URDF, and its limits are used.
"""

from __future__ import annotations

import difflib
import heapq
from collections.abc import Iterable
from typing import Any

from .printable import printable

_LONGEST, _COMPARED = 100, 200
"""Maximum length of a name for which others are suggested, and maximum number of names with which it is compared."""


class _OneLine:
    """A message that names things from files: it fits one line, and its characters have no effect on a terminal."""

    def __str__(self) -> str:
        """The message, with escapes for characters that are not printable."""
        return printable(super().__str__().replace("\r\n", " ").replace("\n", " "))


class KinseekError(_OneLine, Exception):
    """The base of every error of this package."""


class InvalidRobot(KinseekError, ValueError):
    """The description of an arm cannot be used; the message names the invalid part and the valid choices."""


class FailedKinematics(InvalidRobot):
    """A function given as forward kinematics raises, or returns something that is not a pose; the cause is chained."""

    def __init__(self, message: str, q: Any) -> None:
        """Store the joint values at which the function failed."""
        super().__init__(message)
        self.q = q
        """Joint values at which the function failed, (n,)."""

    def __reduce__(self) -> tuple[type[FailedKinematics], tuple[str, Any]]:
        """Pickle with the joint values."""
        return type(self), (str(self), self.q)


class InvalidGoal(KinseekError, ValueError):
    """The target, a tolerance or a weight cannot be used."""


class InvalidProblem(KinseekError, ValueError):
    """A joint vector, start or budget does not fit the arm."""


class InvalidSolver(KinseekError, ValueError):
    """A parameter of a search is out of its range, or the search does not fit into memory."""


class InvalidExport(KinseekError, ValueError):
    """An arm cannot be exported: wrong target, form or folder, or more memory than the controller has."""


class InvalidScene(KinseekError, ValueError):
    """A collision scene is invalid: a shape, a body, a pair of bodies, or a file with geometry."""


class InvalidMap(KinseekError, ValueError):
    """A map of the workspace cannot be made: invalid grid or store, or a worker with another version."""


class InvalidUse(KinseekError, TypeError):
    """A call has no argument of this name, or a result is misused, such as a solution as a truth value."""


class MissingExtra(KinseekError, ImportError):
    """A feature needs an optional dependency; the message says how to install it."""

    def __init__(self, feature: str, extra: str, problem: str = "") -> None:
        """Name the feature, the extra that provides it, and why it cannot be imported although it is installed."""
        broken = f"; the installed one cannot be imported: {problem}" if problem else ""
        super().__init__(f"{feature} needs an optional dependency: pip install 'kinseek[{extra}]'{broken}")
        self.feature, self.extra, self.problem = feature, extra, problem

    def __reduce__(self) -> tuple[type[MissingExtra], tuple[str, str, str]]:
        """Pickle with the feature and the extra."""
        return type(self), (self.feature, self.extra, self.problem)


class PathInterrupted(KinseekError, RuntimeError):
    """The iterator of the poses of a path raised an error; the error is chained."""

    def __init__(self, message: str, path: Any) -> None:
        """Store the path through the poses before the error."""
        super().__init__(message)
        self.path = path

    def __reduce__(self) -> tuple[type[PathInterrupted], tuple[str, Any]]:
        """Pickle with the path."""
        return type(self), (str(self), self.path)


class MapInterrupted(KinseekError, RuntimeError):
    """The making of a map ended early: worker or scheduler gone, disk full. Finished blocks stay; the same call resumes."""

    def __init__(self, message: str, done: int, blocks: int) -> None:
        """Store how many of the blocks are done."""
        super().__init__(message)
        self.done, self.blocks = done, blocks

    def __reduce__(self) -> tuple[type[MapInterrupted], tuple[str, int, int]]:
        """Pickle with the numbers."""
        return type(self), (str(self), self.done, self.blocks)


class InternalError(KinseekError, AssertionError):
    """Two results of kinseek contradict each other. This is a bug in kinseek, never an error of the call.

    The message holds what a bug report needs. Do not rely on any result of the call.
    """


class NotReached(KinseekError, RuntimeError):
    """A goal is missed, and the call is `require`, or cannot go on without it: `Path.timed`, `Arm.move`, `Scene.plan`."""

    def __init__(self, message: str, solution: Any) -> None:
        """Store the whole solution."""
        super().__init__(message)
        self.solution = solution

    def __reduce__(self) -> tuple[type[NotReached], tuple[str, Any]]:
        """Pickle with the solution, so that worker processes can raise it."""
        return type(self), (str(self), self.solution)


class UnitWarning(_OneLine, UserWarning):
    """An angle beyond a full turn, a length far beyond the reach, a period of seconds: perhaps degrees, millimetres, Hz."""


class RepairWarning(_OneLine, UserWarning):
    """A rounded matrix was replaced by the nearest rotation; the message reports how far it was from one."""


class LimitWarning(_OneLine, UserWarning):
    """A file of limits allows more than the description of the robot; its limits are used, as in MoveIt."""


def reason(error: BaseException, most: int = 500) -> str:
    """Return the message of an error, cut to `most` characters; of an error without one, its type."""
    return f"{error!s:.{most}}" or type(error).__name__


def suggest(got: str, valid: Iterable[str], noun: str, listed: str = "") -> str:
    """Return ``unknown <noun> 'got'``, the similar names and the valid choices; `listed` replaces the list of these."""
    choices = sorted(valid)
    said = unknown(got, choices, noun)
    end = "" if said.endswith("?") else "."
    return f"{said}{end} Valid: {listed or ', '.join(map(printable, choices)) or 'none'}"


def unknown(got: str, valid: Iterable[str], noun: str) -> str:
    """Return ``unknown <noun> 'got'`` and the similar names, without the valid choices."""
    near = near_names(got, valid)
    return f"unknown {noun} {got!r:.200}" + (
        f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
    )


def near_names(got: str, valid: Iterable[str]) -> list[str]:
    """Return up to three names that resemble a misspelt one, the most similar first.

    Names come from files. `difflib` needs up to a millisecond for two names of 100 characters, and its time grows faster
    than the square of their length. So longer names are left out, and only the names closest in length are compared.
    """
    if len(got) > _LONGEST:
        return []
    names = [name for name in valid if len(name) <= _LONGEST]
    folded = got.casefold()  # A name that differs only in case, such as UR5e for ur5e, is the nearest of all.
    if same := sorted(name for name in names if name.casefold() == folded):
        return same[:3]
    few = heapq.nsmallest(_COMPARED, names, key=lambda name: abs(len(name) - len(got)))
    return difflib.get_close_matches(got, few, n=3, cutoff=0.5)
