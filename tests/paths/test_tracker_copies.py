"""Pickles and copies of a tracker go on as the tracker itself does."""

from __future__ import annotations

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from kinseek.paths.tracker import Tracker

OUT_OF_REACH = kinseek.pose([2.0, 0.0, 0.5])


def lost_tracker() -> Tracker:
    """Return a tracker that moves, and looks for a lost pose beside the loop."""
    arm = kinseek.load("ur5e")
    tracker = arm.track([0.0, -1.2, 1.4, -0.2, 1.57, 0.0], velocity=1.5, acceleration=20.0, jerk=1000.0)
    for _ in range(30):
        tracker.step(OUT_OF_REACH)
    return tracker


def values_after(tracker: Tracker, target: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.array([tracker.step(target).q for _ in range(300)])


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda tracker: pickle.loads(pickle.dumps(tracker))])
def test_a_copy_makes_the_same_steps_and_is_independent(copied: Callable[[Tracker], Tracker]) -> None:
    tracker = lost_tracker()
    other = copied(tracker)
    target = kinseek.load("ur5e").fk([0.5, -1.0, 1.2, -0.3, 1.5, 0.2])
    expected = values_after(tracker, target)
    assert np.abs(expected[-1] - expected[0]).max() > 0.1
    assert (values_after(other, target) == expected).all()
    assert (other.q == tracker.q).all()


def test_another_process_reads_a_pickle(tmp_path: Path) -> None:
    """A pickle held addresses of this process, and the first step of the other one crashed."""
    tracker = lost_tracker()
    (tmp_path / "tracker.pickle").write_bytes(pickle.dumps(tracker))
    target = kinseek.load("ur5e").fk([0.5, -1.0, 1.2, -0.3, 1.5, 0.2])
    np.save(tmp_path / "target.npy", target)
    program = (
        "import pickle, sys, numpy as np\n"
        "tracker = pickle.load(open('tracker.pickle', 'rb'))\n"
        "target = np.load('target.npy')\n"
        "np.save('q.npy', [tracker.step(target).q for _ in range(300)])\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True, cwd=tmp_path)
    assert (np.load(tmp_path / "q.npy") == values_after(tracker, target)).all()
