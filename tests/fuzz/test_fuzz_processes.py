"""A few forks, pickles and copies beside threads; `python -m tests.fuzz.processes` makes more."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from places import ROOT

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork"),
]


def test_forks_pickles_and_copies_beside_threads() -> None:
    """In a process of its own, whose threads are all known."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.fuzz.processes", "--count", "12", "--seed", "1"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "12 forks, pickles and copies, 0 findings" in done.stdout
