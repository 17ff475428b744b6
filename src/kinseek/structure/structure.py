"""Which closed form an arm has, how exactly, and the numbers that its kernel takes."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.structure import candidates as form
from kinseek.transforms import inverse

from .axes import Axes, axes_of, meeting, nearest_on, slant

NEARLY = 0.005
"""Deviation up to which the closed form of the nearby arm gives starts that are worth it; see `Structure.deviation`."""


BENT = 0.1
"""Sine of the least angle between axes that must not be parallel."""


SHORT = 1e-3
"""Least link between parallel axes, in parts of the arm's size: a shorter one leaves a joint to choose."""


@dataclass(frozen=True, eq=False, repr=False)
class Structure:
    """What the axes of an arm have to do with each other."""

    word: str
    """``"spherical wrist"``, ``"spherical shoulder"``, ``"three parallel axes"`` or ``"none"``."""
    sentence: str
    """What it is, how exactly, and what comes of it."""
    deviation: float
    """How far the arm is from it [rad], lengths in parts of the arm's size; infinite where there is none."""
    exact: bool
    """Is that no more than rounding?"""
    numbers: Array
    """See `kernels.structure.candidates.KIND`."""

    def __repr__(self) -> str:
        """The word and the sentence."""
        return f"Structure({self.word!r}: {self.sentence})"


@dataclass(frozen=True)
class _Found:
    """A structure that an arm has to some deviation."""

    kind: int
    backward: bool
    deviation: float
    numbers: Array


def structure_of(arrays: ChainArrays, size: float) -> Structure:
    """Find the structure of an arm.

    Args:
        arrays: The arm, its tip where goals speak of.
        size: Length that deviations are measured by [m].
    """
    axes = axes_of(arrays)
    if axes is None:
        return _none("a joint slides, or one variable moves several joints or moves one by another angle")
    if len(axes.direction) != 6:
        return _none(f"closed forms are for 6 joints that turn, and the arm has {len(axes.direction)}")
    found = [
        one
        for backward in (False, True)
        for find in (_wrist, _three)
        if (one := find(axes.backwards() if backward else axes, backward, size)) is not None
    ]
    best = min(found, key=lambda one: one.deviation, default=None)
    if best is None or best.deviation > NEARLY:
        near = "" if best is None else f"; nearest is {_words(best)[1]}, off by {best.deviation:.2g}"
        return _none(f"no axes meet or run parallel so that a closed form comes of it, to {NEARLY:g}{near}")
    word, what = _words(best)
    exact = best.deviation <= form.ROUNDING
    how = (
        f"to {best.deviation:.1g}, which is rounding (at most {form.ROUNDING:g})"
        if exact
        else f"nearly: off by {best.deviation:.2g} rad, lengths in parts of {size:.3g} m (at most {NEARLY:g})"
    )
    gives = "every answer comes in closed form" if exact else "the closed form of the nearby arm gives starts"
    return Structure(word, f"{what}, {how}; {gives}", best.deviation, exact, best.numbers)


def with_tip(structure: Structure, arrays: ChainArrays) -> Structure:
    """The structure of an arm whose tip stands elsewhere: its axes have the same."""
    axes = axes_of(arrays)
    if axes is None or structure.numbers[form.KIND] == form.NONE:
        return structure
    numbers = structure.numbers.copy()
    numbers[form.HOME : form.HOME + 12] = _home(axes, bool(numbers[form.BACKWARD]))
    return replace(structure, numbers=numbers)


def _home(axes: Axes, backward: bool) -> Array:
    """What the kernel takes of the pose of the tip, (12,)."""
    return (axes.home[:3] if backward else inverse(axes.home[:3])).ravel()


def _none(why: str) -> Structure:
    return Structure("none", f"{why}; answers are searched", np.inf, False, np.zeros(form.NUMBERS))


def _words(found: _Found) -> tuple[str, str]:
    if found.kind == form.PARALLEL:
        three, meet = ("3, 4 and 5", "1 and 2") if found.backward else ("2, 3 and 4", "5 and 6")
        return "three parallel axes", f"axes {three} are parallel and axes {meet} meet"
    if found.backward:
        return "spherical shoulder", "axes 1, 2 and 3 meet in a point and axes 4 and 5 are parallel"
    return "spherical wrist", "axes 4, 5 and 6 meet in a point and axes 2 and 3 are parallel"


def _wrist(axes: Axes, backward: bool, size: float) -> _Found | None:
    """Axes 4, 5 and 6 meet, axes 2 and 3 are parallel."""
    h = axes.direction
    x, apart = meeting(h[3:], axes.point[3:])
    off = max(apart / size, slant(h[1:3]))
    bent = min(_bend(h[0], h[1]), _bend(h[3], h[4]), _bend(h[4], h[5]))
    return _numbers(form.WRIST, axes, backward, size, off, bent, x, 2)


def _three(axes: Axes, backward: bool, size: float) -> _Found | None:
    """Axes 2, 3 and 4 are parallel, axes 5 and 6 meet."""
    h = axes.direction
    x, apart = meeting(h[4:], axes.point[4:])
    off = max(apart / size, slant(h[1:4]), slant(h[[2, 3]]))
    bent = min(_bend(h[0], h[1]), _bend(h[3], h[4]), _bend(h[4], h[5]))
    return _numbers(form.PARALLEL, axes, backward, size, off, bent, x, 3)


def _bend(a: Array, b: Array) -> float:
    return float(np.linalg.norm(np.cross(a, b)))


def _numbers(
    kind: int, axes: Axes, backward: bool, size: float, off: float, bent: float, x: Array, parallel: int
) -> _Found | None:
    """Write down what the kernel takes; None where a link is too short or axes that must not be are parallel."""
    if not np.isfinite(off) or bent < BENT:
        return None
    senses = np.sign(axes.direction[1:4] @ axes.direction[1])
    h = (senses[:parallel, None] * axes.direction[1 : 1 + parallel]).sum(axis=0)
    h /= np.linalg.norm(h)
    points = nearest_on(axes.direction, axes.point, x)
    corners = [points[1], points[2], points[3] if kind == form.PARALLEL else x]
    links = [b - a for a, b in pairwise(corners)]
    if min(np.linalg.norm(link - h * (h @ link)) for link in links) < SHORT * size:
        return None
    numbers = np.zeros(form.NUMBERS)
    numbers[form.KIND], numbers[form.BACKWARD] = kind, backward
    numbers[form.DEVIATION], numbers[form.SIZE] = off, size
    numbers[form.SENSE : form.SENSE + 3] = senses
    numbers[form.HOME : form.HOME + 12] = _home(axes, backward)
    vectors = {
        form.H1: axes.direction[0],
        form.P1: points[0],
        form.H: h,
        form.E: _across(h),
        form.X: x,
        form.H4: axes.direction[3],
        form.H5: axes.direction[4],
        form.H6: axes.direction[5],
        form.A6: _across(axes.direction[5]),
        form.P2: points[1],
        form.P3: points[2],
        form.P4: points[3],
    }
    for place, vector in vectors.items():
        numbers[place : place + 3] = vector
    return _Found(kind, backward, off, numbers)


def _across(h: Array) -> Array:
    """A unit vector across h, (3,)."""
    across = np.cross(h, np.eye(3)[np.abs(h).argmin()])
    return np.asarray(across / np.linalg.norm(across))


NO_STRUCTURE = _none("the goal leaves more open than a closed form decides")
"""What a goal that is less than a pose has."""


FUNCTION = _none("the arm is a function, whose axes are not known")
"""What an arm has of which only values are known."""
