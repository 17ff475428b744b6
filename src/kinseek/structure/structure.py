"""Find out which closed form an arm has, how exactly, and the parameters of its kernel."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from kinseek.kernels.arm.vectors import Matrix, Transform, Vector
from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.structure import candidates as form
from kinseek.support.transforms import inverse

from .axes import BENT, Axes, axes_of, meeting, nearest_on, slant

NEARLY = 0.005
"""Largest deviation at which the closed form of the nearby arm gives useful starts; see `Structure.deviation`. Not examined
further."""


SHORT = 1e-3
"""Shortest link between parallel axes, relative to the arm's size: a shorter one leaves a joint undetermined."""


@dataclass(frozen=True, eq=False, repr=False)
class Structure:
    """Geometric relations between the axes of an arm."""

    word: str
    """``"spherical wrist"``, ``"spherical shoulder"``, ``"three parallel axes"``, ``"one joint given"`` or ``"none"``."""
    sentence: str
    """A sentence about the structure, its exactness and its consequences."""
    deviation: float
    """Deviation of the arm from the structure [rad], lengths relative to the arm's size; infinite if there is none."""
    exact: bool
    """Whether the deviation is no more than rounding."""
    numbers: Array
    """See `kernels.structure.candidates.STRUCTURE`."""

    def __repr__(self) -> str:
        """Return the word and the sentence."""
        return f"Structure({self.word!r}: {self.sentence})"


def _is_exact(found: form.Structure) -> bool:
    """Whether the deviation is no more than rounding."""
    return found.deviation <= form.ROUNDING


DECIDED = 6
"""Number of joints that a closed form determines."""


def structure_of(arrays: ChainArrays, size: float) -> Structure:
    """Find the structure of an arm.

    Args:
        arrays: The arm, with its tip where goals refer to.
        size: Length that scales deviations [m].
    """
    axes = axes_of(arrays)
    if axes is None:
        return _none("one variable moves several joints, or moves a joint by a multiple of its value")
    swept = len(axes.direction) - DECIDED
    if swept not in (0, 1):
        return _none(f"closed forms exist for 6 or 7 joints, but the arm has {len(axes.direction)}")
    found = [
        one
        # The inverse transforms of the arm may have the structure that the arm itself has not: its wrist is then at the
        # base.
        for backward in (False, True)
        for find in (_wrist, _three, _meeting)
        if (one := _found(find, axes.backwards() if backward else axes, backward, swept, size)) is not None
    ]
    best = min(
        found,
        key=lambda one: (not _is_exact(one), _is_exact(one) and one.kind == form.MEETING, one.deviation),
        default=None,
    )
    # A poor closed form gives starts that are no better than samples.
    if best is None or best.deviation > NEARLY:
        near = (
            ""
            if best is None
            else f"; the nearest structure is that {_words(best)[1]}, off by {best.deviation:.2g}"
        )
        return _none(
            f"no axes intersect or are parallel in a way that gives a closed form, to {NEARLY:g}{near}"
        )
    word, what = _words(best)
    how = (
        f"to {best.deviation:.1g}, which is rounding (at most {form.ROUNDING:g})"
        if _is_exact(best)
        else f"nearly: off by {best.deviation:.2g} rad, lengths in parts of {size:.3g} m (at most {NEARLY:g})"
    )
    gives = (
        "every solution is computed in closed form"
        if _is_exact(best)
        else "the closed form of the nearby arm gives the starts of the search"
    )
    if swept:
        gives = "some of its values are tried, and for each the other joints are computed in closed form"
    return Structure(word, f"{what}, {how}; {gives}", best.deviation, _is_exact(best), _numbers(best))


def with_tip(structure: Structure, arrays: ChainArrays) -> Structure:
    """Return the structure of an arm with another tip: its axes have the same structure."""
    axes, known = axes_of(arrays), form.STRUCTURE.value(structure.numbers)
    if axes is None or known.kind == form.NONE:
        return structure
    numbers = structure.numbers.copy()
    numbers[: form.SWEPT_VALUES] = form.STRUCTURE.numbers(
        known._replace(home=_home(axes, known.backward > 0))
    )
    return replace(structure, numbers=numbers)


def _home(axes: Axes, backward: bool) -> Transform:
    """Return the kernel's parameter of the tip's pose."""
    T = axes.home[:3] if backward else inverse(axes.home[:3])
    x, y, z, p = map(_vector, T.T)
    return Transform(Matrix(x, y, z), p)


def _vector(v: Array) -> Vector:
    return Vector(*v.tolist())


def _numbers(found: form.Structure) -> Array:
    """Return the parameters of the kernel, without values of a swept joint."""
    return np.concatenate([form.STRUCTURE.numbers(found), np.zeros(form.VALUES)])


def _none(why: str) -> Structure:
    nothing = _numbers(form.Structure())
    return Structure("none", f"{why}; solutions are searched numerically", np.inf, False, nothing)


def _words(found: form.Structure) -> tuple[str, str]:
    swept = 1 if found.swept else 0
    joints = [swept + 1 + i for i in range(DECIDED)]
    if found.backward:
        joints = [DECIDED - i for i in range(DECIDED)]
    given = ("joint 7 given, " if found.backward else "joint 1 given, ") if swept else ""
    a, b, c = sorted(joints[3:])
    if found.kind == form.PARALLEL:
        word, what = (
            "three parallel axes",
            f"axes {_listed(joints[1:4])} are parallel and axes {_listed(joints[4:])} meet",
        )
    else:
        word = "spherical shoulder" if found.backward else "spherical wrist"
        others = (
            f"{_listed(joints[1:3])} are parallel"
            if found.kind == form.WRIST
            else f"{_listed(joints[:2])} meet"
        )
        what = f"axes {a}, {b} and {c} meet in a point and axes {others}"
    return ("one joint given" if swept else word), given + what


def _listed(joints: list[int]) -> str:
    """Return joint numbers as text."""
    *first, last = sorted(joints)
    return f"{', '.join(map(str, first))} and {last}"


def _found(
    find: Callable[[Axes, bool, float], form.Structure | None],
    axes: Axes,
    backward: bool,
    swept: int,
    size: float,
) -> form.Structure | None:
    """Find a structure in the axes after the first joint if `swept` is 1, with the kernel's parameters of these joints."""
    rest = axes.distal_to(swept)
    found = None if rest.slides.any() else find(rest, backward, size)
    if found is not None and swept:
        return found._replace(
            swept=1.0,
            slides=float(axes.slides[0]),
            swept_axis=_vector(axes.direction[0]),
            swept_point=_vector(axes.point[0]),
            swept_across=_across(axes.direction[0]),
        )
    return found


def _wrist(axes: Axes, backward: bool, size: float) -> form.Structure | None:
    """Find a wrist whose axes 4, 5 and 6 intersect, with axes 2 and 3 parallel."""
    h = axes.direction
    x, apart = meeting(h[3:], axes.point[3:])
    off = max(apart / size, slant(h[1:3]))
    if not (np.isfinite(off) and _bent(h, (0, 1), (3, 4), (4, 5))):
        return None
    return _parallel(form.WRIST, axes, backward, size, off, x, 2)


def _three(axes: Axes, backward: bool, size: float) -> form.Structure | None:
    """Find parallel axes 2, 3 and 4, with axes 5 and 6 intersecting."""
    h = axes.direction
    x, apart = meeting(h[4:], axes.point[4:])
    off = max(apart / size, slant(h[1:4]), slant(h[[2, 3]]))
    if not (np.isfinite(off) and _bent(h, (0, 1), (3, 4), (4, 5))):
        return None
    return _parallel(form.PARALLEL, axes, backward, size, off, x, 3)


def _meeting(axes: Axes, backward: bool, size: float) -> form.Structure | None:
    """Find a wrist whose axes 4, 5 and 6 intersect, with axes 1 and 2 intersecting."""
    h = axes.direction
    x, apart = meeting(h[3:], axes.point[3:])
    start, apart_first = meeting(h[:2], axes.point[:2])
    off = max(apart, apart_first) / size
    if not (np.isfinite(off) and _bent(h, (0, 1), (3, 4), (4, 5))):
        return None
    elbow = axes.point[2]
    if min(np.linalg.norm(np.cross(h[2], end - elbow)) for end in (start, x)) < SHORT * size:
        return None
    return _common(form.MEETING, axes, backward, size, off, x)._replace(point1=_vector(start))


def _bent(h: Array, *pairs: tuple[int, int]) -> bool:
    """Return whether none of some pairs of axes is nearly parallel."""
    return min(_bend(h[a], h[b]) for a, b in pairs) >= BENT


def _bend(a: Array, b: Array) -> float:
    return float(np.linalg.norm(np.cross(a, b)))


def _parallel(
    kind: int, axes: Axes, backward: bool, size: float, off: float, x: Array, parallel: int
) -> form.Structure | None:
    """Return a structure with parallel axes from the second on; None if a link between these is too short."""
    senses = np.sign(axes.direction[1:4] @ axes.direction[1])
    h = (senses[:parallel, None] * axes.direction[1 : 1 + parallel]).sum(axis=0)
    h /= np.linalg.norm(h)
    points = nearest_on(axes.direction, axes.point, x)
    corners = [points[1], points[2], points[3] if kind == form.PARALLEL else x]
    links = [b - a for a, b in pairwise(corners)]
    if min(np.linalg.norm(link - h * (h @ link)) for link in links) < SHORT * size:
        return None
    found = _common(kind, axes, backward, size, off, x)
    sense2, sense3, sense4 = senses.tolist()
    return found._replace(sense2=sense2, sense3=sense3, sense4=sense4, parallel=_vector(h), across=_across(h))


def _common(kind: int, axes: Axes, backward: bool, size: float, off: float, x: Array) -> form.Structure:
    """Return the parameters that the kernel takes for every kind."""
    points = nearest_on(axes.direction, axes.point, x)
    axis1, axis2, axis3, axis4, axis5, axis6 = map(_vector, axes.direction[:6])
    point1, point2, point3, point4 = map(_vector, points[:4])
    return form.Structure(
        kind=float(kind),
        backward=float(backward),
        deviation=off,
        size=size,
        home=_home(axes, backward),
        axis1=axis1,
        axis2=axis2,
        axis3=axis3,
        axis4=axis4,
        axis5=axis5,
        axis6=axis6,
        across6=_across(axes.direction[5]),
        centre=_vector(x),
        point1=point1,
        point2=point2,
        point3=point3,
        point4=point4,
    )


def _across(h: Array) -> Vector:
    """Return a unit vector at right angles to h, (3,)."""
    across = np.cross(h, np.eye(3)[np.abs(h).argmin()])
    return _vector(across / np.linalg.norm(across))


NO_STRUCTURE = _none("the goal constrains less than a closed form needs")
"""Structure for goals that are less than a pose."""


FUNCTION = _none("the arm has black-box kinematics, so its axes are unknown")
"""Structure for black-box kinematics."""
