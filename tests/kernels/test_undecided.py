"""NaN in what kernels of proofs are given: nothing is claimed, compiled and as plain Python. See `undecided`."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import kinseek
from kinseek.kernels.collision.gaps import DOUBT
from places import ROOT
from undecided import CHECKS


@pytest.mark.parametrize("name", CHECKS)
def test_nothing_is_claimed_where_a_number_is_nan(name: str) -> None:
    assert list(CHECKS[name]()) == []


@pytest.mark.slow
def test_nor_as_plain_python() -> None:
    tests = ROOT / "tests"
    path = os.pathsep.join([str(tests), *sys.path])
    environment = {**os.environ, "NUMBA_DISABLE_JIT": "1", "PYTHONPATH": path}
    script = tests / "undecided.py"
    done = subprocess.run(
        [sys.executable, str(script)], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_joint_values_that_are_no_numbers_are_in_doubt_in_a_scene(value: float) -> None:
    pytest.importorskip("pinocchio")
    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.05)
    scene.add_box("table", (0.2, 0.2, 0.2), kinseek.pose([2.0, 0.0, -1.0]))
    scene.free(np.zeros(6))
    broad = scene._engine.broad
    q = np.array([[0.0, -1.5, 0.3, 0.0, 0.0, 0.0]] * 9)
    q[4, 2] = value
    verdicts, _ = broad.verdicts(q, 0.0, 1e-6)
    assert verdicts[4] == DOUBT
    assert (np.delete(verdicts, 4) != DOUBT).all()
    assert (broad.bounds(q)[4] <= 0.0).all()
