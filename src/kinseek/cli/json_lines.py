"""``solve --jsonl``: a pose per line on standard input, a solution per line on standard output, without delay."""

from __future__ import annotations

import json
import math
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, cast

from kinseek.branches.result import Branches
from kinseek.errors import InvalidGoal, InvalidProblem, KinseekError, suggest
from kinseek.poses import one_pose
from kinseek.support.validation import is_finite_number

from .files import MOST_LINE
from .goals import DIRECTIONS, TURNS, silent_pose, suspect_degrees
from .output import direct_output, write_out
from .report import branches_facts, line_facts
from .request import SolveRequest
from .words import joints_in_order

_KEYS = ("id", "matrix", "position", *TURNS, *DIRECTIONS, "near")


def solve_lines(request: SolveRequest) -> int:
    """Solve one line after the other; a line that is not a pose gives an error line, and the next one is read.

    Returns:
        2 if a line was wrong or the output cannot be written, 141 if the reader is gone, 1 if a pose was not reached, else
        0.
    """
    code = 0
    with direct_output():
        for number, line in _lines():
            facts: dict[str, Any] = {"line": number}
            try:
                fields = _read(line)
                facts |= {"id": fields["id"]} if "id" in fields else {}
                found, reached = _solve_line(_nearer(request, fields), fields, number)
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
    """Yield the lines that are not empty, with their numbers, as soon as each arrives."""
    if sys.stdin is None:
        raise InvalidProblem("--jsonl reads standard input, but there is none")
    stream: Any = getattr(sys.stdin, "buffer", sys.stdin)
    number = 0
    while line := stream.readline(MOST_LINE + 1):
        number += 1
        rest = line
        while len(rest) > MOST_LINE and rest[-1:] not in (b"\n", "\n"):  # The rest of a long line is dropped.
            rest = stream.readline(MOST_LINE + 1)
        if line.strip() or len(line) > MOST_LINE:
            yield number, line


def _read(line: bytes | str) -> dict[str, Any]:
    if len(line) > MOST_LINE:
        raise InvalidGoal(f"a line has at most {MOST_LINE:,} bytes, got more")
    try:
        fields = json.loads(
            line, parse_float=_finite, parse_constant=_finite, object_pairs_hook=_with_distinct_keys
        )
    except json.JSONDecodeError as error:
        raise InvalidGoal(f"not JSON: {error.msg} at letter {error.pos + 1}") from None
    except InvalidGoal:
        raise
    except (ValueError, RecursionError) as error:  # Not text, or nested too deeply.
        raise InvalidGoal(f"not JSON: {error}") from None
    if not isinstance(fields, dict):
        raise InvalidGoal(f"a line must be an object with {', '.join(_KEYS)}; got {type(fields).__name__}")
    for key, value in fields.items():
        if key not in _KEYS:
            raise InvalidGoal(suggest(key, _KEYS, "key"))
        # NumPy takes flags for 0 and 1 if numbers are beside them, and a rotation that is null is none.
        if key not in ("id", "near") and any(each is None or isinstance(each, bool) for each in _flat(value)):
            raise InvalidGoal(f"{key} must be numbers, got {json.dumps(value)[:200]}")
    return fields


def _with_distinct_keys(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Make an object; Python keeps the last of several values of a key."""
    fields = dict(pairs)
    if len(fields) < len(pairs):
        counts = Counter(key for key, _ in pairs)
        raise InvalidGoal(f"the key {next(key for key in counts if counts[key] > 1)!r:.200} is there twice")
    return fields


def _flat(value: Any) -> list[Any]:
    """Return what is in the rows of a list, one after the other."""
    rows = value if isinstance(value, list) else [value]
    return [each for row in rows for each in (row if isinstance(row, list) else [row])]


def _finite(text: str) -> float:
    """Read a number that can be repeated in the output; Python also reads NaN and infinities, which are not JSON."""
    number = float(text)
    if not math.isfinite(number):
        raise InvalidGoal(f"numbers must be finite, got {text}")
    return number


def _solve_line(request: SolveRequest, fields: dict[str, Any], number: int) -> tuple[dict[str, Any], bool]:
    in_scene = request.scene is not None
    spec, deg = request.goal_spec, request.deg
    goal = spec.goal(_target(fields, number, spec.position_only, deg), deg)
    if request.every:
        found = request.branches(goal)
        return branches_facts(cast(Branches, found), in_scene), len(found) > 0
    solution = request.solve(goal)
    return line_facts(solution, in_scene), bool(solution.success)


def _target(fields: dict[str, Any], number: int, position_only: bool, deg: bool) -> Any:
    turns = [name for name in (*TURNS, *DIRECTIONS) if name in fields]
    axes = [name for name in turns if name in DIRECTIONS]
    if "matrix" in fields:
        if turns or "position" in fields:
            raise InvalidGoal(
                f"matrix is a whole pose; it cannot be combined with {' or '.join([*turns, 'position'])}"
            )
        return one_pose(fields["matrix"], "matrix")
    if "position" not in fields:
        raise InvalidGoal("a line needs the key position or matrix")
    if len(turns) - max(len(axes) - 1, 0) != (0 if position_only else 1):
        one = f"exactly one of {', '.join(TURNS)}, or z_axis with x_axis"
        expected = "no rotation with --position-only" if position_only else one
        raise InvalidGoal(f"a line needs {expected}; got {' and '.join(turns) or 'none'}")
    turn = {name: fields[name] for name in turns}
    if turns and all(_has_rows(fields[name]) for name in ("position", *turns)):
        # Each position with each rotation: a short line would be gigabytes of poses.
        raise InvalidGoal(f"position must be one pose, got several rows for it and for {turns[0]}")
    target = one_pose(silent_pose(fields["position"], turn, deg), "position")
    suspect_degrees(turn, deg, f"line {number:,}: {' '.join(turn)}")
    return target


def _has_rows(value: Any) -> bool:
    return isinstance(value, list) and any(isinstance(each, list) for each in value)


def _are_numbers(value: Any) -> bool:
    """Return whether a value is a list of numbers that floats can represent; integers in JSON have any length."""
    return isinstance(value, list) and all(map(is_finite_number, value))


def _nearer(request: SolveRequest, fields: dict[str, Any]) -> SolveRequest:
    if "near" not in fields:
        return request
    near = fields["near"]
    if not _are_numbers(list(near.values()) if isinstance(near, dict) else near):
        raise InvalidProblem(
            f"near must be a list of numbers, or joint names with values, got {json.dumps(near):.200}"
        )
    return replace(request, near=joints_in_order(request.arm, near, "near", request.deg))
