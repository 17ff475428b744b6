"""Export of arms for a web page or Node: numbers as JSON, and JavaScript that calls the WebAssembly module.

For an arm only its chain and derived data are written. The samples of the atlas, which take megabytes, are computed by the
JavaScript with the same kernel as in Python.
"""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.arm import Arm
from kinseek.branches.index import BranchIndex, index_of
from kinseek.errors import InvalidExport
from kinseek.goal import Goal
from kinseek.kernels.arm.division import NONE, Division
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.atlas.task import ROUTINES, ROWS
from kinseek.kernels.atlas.tree import BESIDE, LEAF_SIZE
from kinseek.kernels.branches.refine_all import ANSWER
from kinseek.kernels.branches.search import ROWS as MOST_ANSWERS
from kinseek.kernels.entry import ENTRIES, Bundle, Leaf
from kinseek.kernels.proof.infeasibility import OFTEN, STEPS
from kinseek.kernels.proof.progress import COUNT, ENDED, FOUND, FULL, SEEN, STUCK
from kinseek.problem import Problem
from kinseek.proof.boxes import Run, tuning_of
from kinseek.proof.reduce import question, start_boxes
from kinseek.robots.sampling import low_discrepancy_steps
from kinseek.support.transforms import inverse, square
from kinseek.support.turns import one_turn

from .design import exported_axes
from .folder import Owned, own_folder, write_files
from .wasm import CALLED, PLACES, wasm_module

SCRIPT = Path(__file__).parent / "js" / "kinseek.js"
"""Copied unchanged."""

_MARK = "// SPDX-License-Identifier: Apache-2.0\n// Inverse kinematics"
"""The beginning of `SCRIPT`, including earlier versions."""

_OWNED = Owned(frozenset({"kinseek.js", "arms.json", "kinseek.wasm"}), "kinseek.js", _MARK)

_MADE = (
    "atlas.tree.points",
    "atlas.tree.axis",
    "atlas.tree.split",
    "atlas.tree.beside",
    "atlas.middle",
    "atlas.poses",
)
"""Rows of a task that JavaScript computes."""
_KINDS = {"f": "<f8", "i": "<i8", "b": "|b1"}


def to_wasm(arms: Sequence[Arm], folder: str | Path, module: bytes | None = None) -> Path:
    """Write arms and the kernels for a web page or for Node: see docs/page.md.

    Args:
        arms: Arms with axes and links.
        folder: Output folder; it is made if it does not exist, but its parent must exist.
        module: The kernels, from an earlier `wasm_module`; by default they are compiled.

    Returns:
        The folder.

    Raises:
        InvalidExport: An arm with black-box kinematics, two arms of one name, or a folder that cannot be written or has
            files of these names that are not kinseek's.
        MissingExtra: Numba or ziglang is not installed.
    """
    arms_json = json.dumps(arms_as_data(arms), allow_nan=False).encode()
    own_folder(folder, _OWNED)
    kernels = wasm_module() if module is None else module
    files = {"kinseek.js": SCRIPT.read_bytes(), "arms.json": arms_json, "kinseek.wasm": kernels}
    write_files(folder, _OWNED, files)
    return Path(folder)


def arms_as_data(arms: Sequence[Arm]) -> dict[str, Any]:
    """Return the data on kernels and arms for JavaScript, as JSON takes them.

    Raises:
        InvalidExport: An arm with black-box kinematics, or two arms of one name.
    """
    names = [arm.name for arm in arms]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise InvalidExport(
            f"arms must have distinct names, got {', '.join(map(repr, twice))} more than once"
        )
    return {
        "version": kinseek.__version__,
        "entries": {name: _entry_as_data(name) for name in CALLED},
        "rows": list(_row_names(ROWS, "")),
        "routines": {"row": ROUTINES, "places": PLACES},
        "lanes": LANES,
        "leaf": LEAF_SIZE,
        "beside": BESIDE,
        "branches": {"most": MOST_ANSWERS, "behind": ANSWER},
        "proof": {
            "count": COUNT,
            "seen": SEEN,
            "stuck": STUCK,
            "outcomes": {"ended": ENDED, "found": FOUND, "full": FULL},
        },
        "arms": [_arm_as_data(arm) for arm in arms],
    }


def _entry_as_data(name: str) -> dict[str, Any]:
    one = ENTRIES[name]
    takes = [[path, leaf.element, len(leaf.shape)] for path, leaf in one.leaves()]
    return {"takes": takes, "returns": [leaf.element for leaf in one.returns]}


def _row_names(rows: Any, before: str) -> Iterator[str]:
    """Yield the names of the rows of a task's handle, in order, including nested ones."""
    for name, row in rows.rows.items():
        if isinstance(row, str):
            yield before + name
        else:
            yield from _row_names(row, f"{before}{name}.")


def _arm_as_data(arm: Arm) -> dict[str, Any]:
    chain = exported_axes(arm, "WebAssembly")
    problem = Problem(arm.mechanism, Goal.pose(np.eye(4)))
    index = index_of(problem)
    task = dict(zip(_row_names(ROWS, ""), index.fine._arrays, strict=True))
    division = index.fine.division
    arrays = {name: each for name, each in task.items() if name not in (*_MADE, "routines")}
    tables = index.tables
    arrays |= {"view": index.view, "mirrors": tables.mirrors, "structure": tables.structure}
    arrays |= {"joint": tables.joint, "table": tables.table}
    return {
        "name": arm.name,
        "joint_names": list(arm.joint_names),
        "kinds": list(chain.kinds),
        "lower": arm.lower.tolist(),
        "upper": arm.upper.tolist(),
        "freedom": index.freedom,
        "arrays": {name: _array_as_data(each) for name, each in arrays.items()},
        "division": division._asdict(),
        "samples": _samples(problem, index, division),
        "proof": _proof_as_data(problem),
    }


def _array_as_data(values: NDArray[Any]) -> dict[str, Any]:
    """Convert an array exactly."""
    data = values.astype(_KINDS[values.dtype.kind]).tobytes()
    return {"kind": values.dtype.kind, "shape": values.shape, "data": base64.b64encode(data).decode()}


def _samples(problem: Problem, index: BranchIndex, division: Division) -> dict[str, Any]:
    """Return how the middle joints are sampled, see `robots.sampling.middle_samples`."""
    chain = problem.chain
    first, last = int(division.head != NONE), chain.dof - int(division.tail != NONE)
    lower, upper = one_turn(chain.lower[first:last], chain.upper[first:last], chain.turns[first:last])
    return {
        "first": first,
        "steps": low_discrepancy_steps(last - first).tolist(),
        "lower": lower.tolist(),
        "upper": upper.tolist(),
        "coarse": index.coarse.samples,
        "fine": index.fine.samples,
    }


def _proof_as_data(problem: Problem) -> dict[str, Any]:
    """Return the constant arguments of proofs about an arm; only the target and the margin for rounding vary.

    The target argument is ``left · pose · right``, and the margin is ``margin_a · (reach + distance of that target)``.
    """
    form, proof_goal, last_joint = question(problem)
    chain, fixed = problem.chain, problem.arrays.fixed
    left = inverse(fixed[0]) if form.head != NONE else np.eye(4)[:3]
    right = square(inverse(left)) @ square(proof_goal.target)  # The pose of this problem is the identity.
    boxes = start_boxes(chain, last_joint.present)
    run = Run(
        problem, (form, proof_goal, last_joint), boxes, np.zeros(chain.dof), tuning_of(problem, OFTEN, STEPS)
    )
    takes = ENTRIES["ks_search_boxes"].takes
    arguments = {"kind": run.kind, "question": run.question, "tuning": run.tuning}
    return {
        "given": {
            path: _array_as_data(value) if isinstance(value, np.ndarray) else _number(value)
            for path, value in _flat("", takes, arguments)
        },
        "memory": {
            path: {"kind": each.dtype.kind, "shape": each.shape}
            for path, each in _flat("", takes, {"memory": run.memory})
        },
        "left": left.tolist(),
        "right": right[:3].tolist(),
        "reach": proof_goal.margin / proof_goal.margin_a - float(np.linalg.norm(proof_goal.target[:, 3])),
        "boxes": _array_as_data(boxes),
    }


def _flat(before: str, takes: Any, values: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    for name, one in takes.items():
        if name not in values:
            continue
        if isinstance(one, Leaf):
            yield before + name, values[name]
        else:
            assert isinstance(one, Bundle)
            yield from _flat(f"{before}{name}.", one.fields, values[name]._asdict())


def _number(value: Any) -> float | int:
    return int(value) if isinstance(value, bool | int | np.integer | np.bool_) else float(value)
