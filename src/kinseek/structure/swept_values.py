"""Choose the values that are tried for the swept joint of a closed form; they are determined once per arm by a trial."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arrays import Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.structure import candidates as form
from kinseek.kernels.structure.swept_values import try_swept_values

from .structure import Structure

SWEPT_VALUES = 24
"""Values that are tried for each pose of the trial. Not examined further."""


SAMPLES = 64
"""Samples of the atlas for each pose of the trial. Not examined further."""


def choose_swept_values(structure: Structure, handle: Indices, size: float, samples: int) -> None:
    """Choose the values of the swept joint that are tried, if there is one.

    Each value solves most of the poses of the trial that the earlier ones leave.

    Args:
        structure: Structure of the arm; receives the values.
        handle: The task of the arm, which reads the numbers of the structure.
        size: Largest value that is tried for a prismatic joint [m].
        samples: Number of samples of the atlas.
    """
    numbers, found = structure.numbers, form.STRUCTURE.value(structure.numbers)
    if not found.swept:
        return
    farthest = size if found.slides else np.pi
    swept_values = farthest * (2.0 * np.arange(SWEPT_VALUES) / SWEPT_VALUES - 1.0)
    report = np.zeros((max(samples // SAMPLES, 1), SWEPT_VALUES), dtype=np.int64)
    try_swept_values(handle, swept_values, report, LANES)
    for k in range(form.VALUES):
        served = report.sum(axis=0)
        best = int(np.argmax(served))
        if not served[best]:
            break
        numbers[form.STRUCTURE.first["swept"]] = k + 1
        numbers[form.SWEPT_VALUES + k] = swept_values[best]
        # Greedy covering: poses that a chosen value serves do not count for the next one.
        report[report[:, best] == 1] = 0
