"""Which values of a joint in front of a closed form are tried: found by trial, once for an arm."""

from __future__ import annotations

import numpy as np

from kinseek.kernels.arrays import Indices
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.structure import candidates as form
from kinseek.kernels.structure.swept_values import try_swept_values

from .structure import Structure

SWEPT_VALUES = 24
"""Leads that are tried of each pose of the trial."""


SAMPLES = 64
"""One pose of the trial for so many samples of the atlas."""


def choose_swept_values(structure: Structure, handle: Indices, size: float, samples: int) -> None:
    """Write down which leads of the joint in front are tried, if there is one: each serves most of what those before leave.

    Args:
        structure: Of the arm; receives them.
        handle: The task of the arm, which reads the numbers of the structure.
        size: How far from the hand a joint that slides may be [m].
        samples: How many the atlas has.
    """
    numbers = structure.numbers
    if not numbers[form.SWEPT]:
        return
    farthest = size if numbers[form.SLIDES] else np.pi
    swept_values = farthest * (2.0 * np.arange(SWEPT_VALUES) / SWEPT_VALUES - 1.0)
    report = np.zeros((max(samples // SAMPLES, 1), SWEPT_VALUES), dtype=np.int64)
    try_swept_values(handle, swept_values, report, LANES)
    for k in range(form.VALUES):
        served = report.sum(axis=0)
        best = int(np.argmax(served))
        if not served[best]:
            break
        numbers[form.SWEPT] = k + 1
        numbers[form.SWEPT_VALUES + k] = swept_values[best]
        report[report[:, best] == 1] = 0
