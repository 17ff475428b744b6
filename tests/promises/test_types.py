"""What a strict type checker says of programs that use kinseek: the right ones pass, a misspelt name does not."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import kinseek

pytestmark = pytest.mark.slow

pytest.importorskip("mypy")

HEAD = """
from typing import Any
import numpy as np
from numpy.typing import NDArray
import kinseek

arm = kinseek.load("ur5e")
target = kinseek.pose([0.3, 0.2, 0.4], quat_wxyz=[0.0, 1.0, 0.0, 0.0])
rows = arm.sample(5, seed=1)
unknown: NDArray[np.float64] = np.array(target)
untyped: Any = target
"""

RIGHT = """
solution = arm.ik(target, near=[0.0] * 6)
if solution.success:
    error: float = solution.position_error
    print(f"{error:.2e}", solution.status.name, solution.evaluations + 1)
status: kinseek.Status = solution.status
success: bool = arm.ik(arm.fk([0.1] * 6)).success
listed: bool = arm.ik([[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.5], [0.0, 0.0, 0.0, 1.0]]).success

batch = arm.ik(arm.fk(rows))
share = batch.success.mean()
worst: np.float64 = batch.position_error.max()
missed: NDArray[np.float64] = batch.q[~batch.success]
many = arm.ik([target, target]).evaluations.sum()
for one in batch:
    if one.success:
        print(one.position_error)
for each in batch.each():
    reached: bool = each.success
print(len(batch), batch[3].success, batch[2:5].success.all(), batch[~batch.success].q)

def either(poses: NDArray[np.float64]) -> kinseek.Solution:
    answer = arm.ik(poses)
    print(answer.success.mean(), bool(answer.success))
    return answer.require()

if arm.ik(untyped).success or arm.ik(kinseek.Goal.position([1.0, 2.0, 3.0])).success:
    pass
branches = arm.branches(target, order="limits")
if branches and branches.complete:
    for q in branches:
        print(arm.jacobian(q), arm.manipulability(q))
counts = arm.branches(arm.fk(rows)).counts
found = arm.branches(unknown)
if isinstance(found, kinseek.Branches):
    print(found.complete)
arm.ik(target, prefer="dexterity", threads=2)
kinseek.Goal.pose(target, free="rz", frame="base")
kinseek.pose(rows[:, :3], rpy=rows[:, 3:])
kinseek.pose([0.3, 0.2, 0.4], z_axis=[0.0, 0.0, -1.0], x_axis=[1.0, 0.0, 0.0], skew=0.1)
kinseek.pose(rows[:, :3], z_axis=rows[:, 3:], y_axis=[1.0, 0.0, 0.0])
dense = arm.ik(kinseek.interpolate([target, target], step=0.1, turn=0.1)).success.all()
pose: NDArray[np.float64] = arm.fk(rows, link="tool0")
"""

WRONG = [
    "arm.ik(target).sucess",
    "arm.ik(arm.fk(rows)).sucess",
    "arm.ik(unknown).sucess",
    "arm.ik(untyped).sucess",
    "arm.ik(kinseek.Goal.pose(target)).sucess",
    "arm.ik(arm.fk(rows))[3].sucess",
    "[one.sucess for one in arm.ik(arm.fk(rows))]",
    "[one.sucess for one in arm.ik(unknown).each()]",
    "arm.ik(target).success.mean()",
    "arm.ik(target).status.nme",
    "flag: bool = arm.ik(arm.fk(rows)).success",
    "arm.branches(target).compleet",
    "arm.branches(arm.fk(rows)).complete",
    "arm.branches(unknown).compleet",
    'arm.ik(target, prefer="mid_range")',
    'arm.branches(target, order="mid_range")',
    'kinseek.Goal.pose(target, frame="world")',
    "arm.ik(target, nearr=[0.0] * 6)",
    "arm.fk(rows, link=7)",
    "arm.branches(target, seed=[0.0] * 6)",
    "arm.prove(target, timeout=1.0)",
    "arm.follow(arm.fk(rows), seed=[0.0] * 6)",
    "arm.follow_stream(arm.fk(rows), seed=[0.0] * 6)",
    "arm.track([0.0] * 6, dt=0.01)",
    'kinseek.load("ur5e", ee_link="tool0")',
    "kinseek.pose([0.0, 0.0, 0.0], quat=[1.0, 0.0, 0.0, 0.0])",
    "kinseek.Goal.pose(target, tol=1e-3)",
]


def check(text: str) -> list[str]:
    """What mypy says of a program that follows `HEAD`: lines with an error, counted from its end."""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder) / "program.py"
        program.write_text(HEAD + text)
        options = ["--strict", "--follow-imports=silent", "--no-error-summary", "--cache-dir", CACHE.name]
        done = subprocess.run(
            [sys.executable, "-m", "mypy", *options, str(program)],
            env={**os.environ, "MYPYPATH": str(Path(kinseek.__file__).parents[1])},
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode in (0, 1), done.stderr
        return done.stdout.splitlines()


CACHE = tempfile.TemporaryDirectory(prefix="kinseek_types_")


def test_right_programs_pass() -> None:
    assert check(RIGHT) == []


def test_every_wrong_line_is_an_error() -> None:
    said = check("\n".join(WRONG))
    first = HEAD.count("\n") + 1
    caught = {int(line.split(":")[1]) - first for line in said if ": error:" in line}
    assert [WRONG[i] for i in range(len(WRONG)) if i not in caught] == []
