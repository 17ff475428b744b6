"""``solve --jsonl``: a pose a line on standard input, an answer a line on standard output, at once."""

from __future__ import annotations

import json
import math
import sys
import warnings
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

import numpy as np

from kinseek.branches.result import Branches
from kinseek.errors import InvalidGoal, InvalidProblem, KinseekError, UnitWarning, suggest
from kinseek.poses import one_pose, pose
from kinseek.units import warn_of_angles

from .goals import IN_DEGREES, TURNS
from .output import direct_output, write_out
from .question import Question
from .report import answer_facts, branches_facts
from .words import joints_in_order

_KEYS = ("id", "matrix", "position", *TURNS, "near")


def solve_lines(question: Question, deg: bool, every: bool, count: int | None) -> int:
    """Answer one line after the other; a line that is no pose gets an error line, and the next is read.

    Args:
        question: What is asked of every line.
        deg: Are angles in degrees?
        every: Is every answer wanted?
        count: How many of them at most.

    Returns:
        2 where a line was wrong or the output cannot be written, 141 where nobody reads it, 1 where a pose was not reached,
        else 0.
    """
    code = 0
    with direct_output():
        for number, line in _lines():
            facts: dict[str, Any] = {"line": number}
            try:
                asked = _read(line)
                facts |= {"id": asked["id"]} if "id" in asked else {}
                found, reached = _answer(_nearer(question, asked, deg), asked, number, deg, every, count)
                facts |= found
                code = max(code, 0 if reached else 1)
            except KinseekError as error:
                facts["error"] = str(error)
                code = 2
            failed = write_out(json.dumps(facts, allow_nan=False) + "\n", 0)
            if failed:
                return failed
    return code


def _lines() -> Iterator[tuple[int, bytes]]:
    """Lines that hold something, with their numbers, each as soon as it is there."""
    if sys.stdin is None:
        raise InvalidProblem("--jsonl reads standard input, and there is none")
    stream: Any = getattr(sys.stdin, "buffer", sys.stdin)
    number = 0
    while line := stream.readline():
        number += 1
        if line.strip():
            yield number, line


def _read(line: bytes | str) -> dict[str, Any]:
    try:
        asked = json.loads(line, parse_float=_finite, parse_constant=_finite)
    except json.JSONDecodeError as error:
        raise InvalidGoal(f"not JSON: {error.msg} at letter {error.pos + 1}") from None
    except InvalidGoal:
        raise
    except (ValueError, RecursionError) as error:  # No text, or nested without end.
        raise InvalidGoal(f"not JSON: {error}") from None
    if not isinstance(asked, dict):
        raise InvalidGoal(f"a line must be an object with {', '.join(_KEYS)}; got {type(asked).__name__}")
    for key in asked:
        if key not in _KEYS:
            raise InvalidGoal(suggest(key, _KEYS, "key"))
    return asked


def _finite(text: str) -> float:
    """Read a number that an answer can repeat; Python reads NaN and infinities as well, which are not JSON."""
    number = float(text)
    if not math.isfinite(number):
        raise InvalidGoal(f"numbers must be finite, got {text}")
    return number


def _answer(
    question: Question, asked: dict[str, Any], number: int, deg: bool, every: bool, count: int | None
) -> tuple[dict[str, Any], bool]:
    in_scene = question.scene is not None
    goal = question.asked.goal(_target(asked, number, question.asked.position_only, deg))
    if every:
        found = question.branches(goal, count)
        return branches_facts(cast(Branches, found), in_scene), len(found) > 0
    solution = question.answer(goal)
    return answer_facts(solution, in_scene), bool(solution.success)


def _target(asked: dict[str, Any], number: int, position_only: bool, deg: bool) -> Any:
    turns = [name for name in TURNS if name in asked]
    if "matrix" in asked:
        if turns or "position" in asked:
            raise InvalidGoal(
                f"matrix is a whole pose; it stands without {' and '.join([*turns, 'position'])}"
            )
        return one_pose(asked["matrix"], "matrix")
    if "position" not in asked:
        raise InvalidGoal("a line needs position, or matrix")
    if len(turns) != (0 if position_only else 1):
        wanted = "no rotation with --position-only" if position_only else f"exactly one of {', '.join(TURNS)}"
        raise InvalidGoal(f"a line needs {wanted}; got {' and '.join(turns) or 'none'}")
    turn = {name: asked[name] for name in turns}
    for name in (name for name in turns if name in IN_DEGREES and _are_numbers(turn[name])):
        if deg:
            turn[name] = np.deg2rad(turn[name])
        else:
            warn_of_angles(turn[name], f"line {number:,}: {name}", "add --deg", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitWarning)  # Said above, in the words of a command line.
        return one_pose(pose(asked["position"], **turn), "position")


def _are_numbers(value: Any) -> bool:
    """Whether it is a list of numbers that an array of floats holds; JSON has integers of any length."""
    return isinstance(value, list) and all(
        isinstance(each, int | float) and abs(each) <= sys.float_info.max for each in value
    )


def _nearer(question: Question, asked: dict[str, Any], deg: bool) -> Question:
    if "near" not in asked:
        return question
    near = asked["near"]
    if not _are_numbers(list(near.values()) if isinstance(near, dict) else near):
        raise InvalidProblem(
            f"near must be a list of numbers, or joint names with values, got {json.dumps(near)}"
        )
    return replace(question, near=joints_in_order(question.arm, near, "near", deg))
