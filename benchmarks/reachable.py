"""Targets that can be reached: which are solved by plain forward kinematics, which are missed, and times of calls."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek

from .page import Page
from .targets import Array

Flags = NDArray[np.bool_]


def missed(label: str, answer: kinseek.Solution, good: Flags, made_from: Array) -> list[str]:
    """A line for each target that is not reached; prints how many solutions claim what is not so.

    Args:
        label: Of the arm and the kind of targets.
        answer: The solutions of a batch of k targets.
        good: Which reach their target, by plain forward kinematics, (k,).
        made_from: Joint values that the targets were made from, (k, n), [rad] or [m].
    """
    claimed = np.asarray(answer.success)
    if (claimed != good).any():
        false, modest = (claimed & ~good).sum(), (good & ~claimed).sum()
        print(f"  {label}: {false} answers claim what outside FK denies, {modest} deny it")
    return [
        f"{label}, number {i}: {answer.position_error[i]:.1e} m, {answer.orientation_error[i]:.1e} rad; made from "
        f"q = {made_from[i].tolist()}"
        for i in np.flatnonzero(~good)
    ]


def share(good: Any, digits: int = 3) -> str:
    """Percent, rounded down, so that 100 is all of them."""
    scale = 10.0**digits
    # Rounding of the mean must not take a digit away.
    return f"{np.floor(100 * scale * np.mean(good) + 1e-6) / scale:.{digits}f}"


def list_misses(page: Page, misses: list[str]) -> None:
    """End a page with all targets that are missed, and with their number."""
    page.head(f"Misses: {len(misses)}")
    page.items(misses)
    print(f"{len(misses)} misses")
