"""Algorithms 1 and 2 of the paper, written out plainly on `Arm.fk`, with a switch for each ambiguous passage.

`kinseek.DivideAndConquer` had to choose one meaning for every passage. To say under which meaning a printed
figure comes out as printed, the others must run too; this is the slow twin that can. Its default is what
kinseek chose, wherever all joints turn fully.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

import kinseek

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_LEAVES = 400_000
"""Leaves evaluated at once; the points of a batch are cut into pieces to stay near it."""


@dataclass(frozen=True)
class Reading:
    """One way to read the paper, Sec. 3.1 and 3.2."""

    divisor: str = "D"
    """Each pass divides the spacing by ``"D"`` (Algorithm 2) or by ``"B"`` (the text of Sec. 3.1)."""
    rounding: str = "down"
    """``"down"``, ``"up"``, or ``"exact"``: keep fractions of a node and round only the node's number."""
    last: str = "one"
    """``"one"``: end with a spacing of one (the text); ``"below one"``: stop at a spacing < 1 (Alg. 2)."""
    first: str = "D"
    """The first pass tries ``"D"`` values from the lower limit on (Sec. 3.1), or ``"formula"``: 2(⌊D/2⌋ + Br) - 1 of
    them around the zero configuration, as Sec. 3.2 says of every pass and Algorithm 2 begins."""
    ends: str = "wrap"
    """At an end of the range ``"wrap"`` around, ``"clip"`` what is outside, or ``"slide"`` the window in; or
    ``"turns wrap"``: wrap the joints with a full turn and clip the others."""
    orientation: bool = True
    """Does the orientation count in the error?"""
    position_weight: float = 1.0
    """K_P, per [m]."""
    orientation_weight: float = 1.0
    """K_A."""

    def spacings(self, branching_factor: int, divisions: int) -> list[float]:
        """Spacing of every pass, in nodes."""
        divide = divisions if self.divisor == "D" else branching_factor
        values = [self._rounded(branching_factor / divisions)]
        while values[-1] > 1:
            # Rounding up alone would never come below one.
            following = self._rounded(values[-1] / divide)
            if following < 1:
                if self.last == "one":
                    values.append(1.0)
                break
            values.append(following)
        return values

    def _rounded(self, spacing: float) -> float:
        return {"down": float(np.floor(spacing)), "up": float(np.ceil(spacing)), "exact": spacing}[
            self.rounding
        ]


def search(
    arm: kinseek.Arm, targets: Array, reading: Reading, branching_factor: int, divisions: int, breadth: int
) -> Array:
    """Answer many poses by Algorithm 2; return the joint values, (k, n), [rad] or [m].

    Args:
        arm: The arm.
        targets: Wanted poses, (k, 4, 4), lengths in [m].
        reading: Which meaning to give to the ambiguous passages.
        branching_factor: The paper's B.
        divisions: The paper's D.
        breadth: The paper's Br, the same for every joint.
    """
    spacings = reading.spacings(branching_factor, divisions)
    best_nodes = np.zeros((len(targets), arm.dof), dtype=np.int64)
    if reading.first == "formula":
        zero = np.clip(-arm.lower / (arm.upper - arm.lower), 0, 1)
        best_nodes[:] = np.rint(zero * branching_factor).astype(np.int64).clip(0, branching_factor - 1)
    best_errors = np.full(len(targets), np.inf)
    side = divisions // 2 + breadth - 1
    for number, spacing in enumerate(spacings):
        around = number or reading.first == "formula"
        offsets = np.arange(-side, side + 1) if around else np.arange(divisions)
        shifts = np.rint(offsets * spacing).astype(np.int64)
        for piece in _pieces(len(targets), len(shifts) ** arm.dof):
            centre = best_nodes[piece]
            leaves = _leaves(centre, shifts, branching_factor, reading.ends, arm.upper - arm.lower > 6.28)
            errors = _errors(arm, values_of(arm, leaves, branching_factor), targets[piece], reading)
            choice = errors.argmin(axis=1)
            rows = np.arange(len(choice))
            better = errors[rows, choice] < best_errors[piece]
            best_errors[piece] = np.where(better, errors[rows, choice], best_errors[piece])
            best_nodes[piece] = np.where(better[:, None], leaves[rows, choice], centre)
    return values_of(arm, best_nodes, branching_factor)


def values_of(arm: kinseek.Arm, nodes: Indices, branching_factor: int) -> Array:
    """Joint values of nodes, (..., n): the paper's 360/B · index, from the lower limit, [rad] or [m]."""
    return np.asarray(arm.lower + (arm.upper - arm.lower) / branching_factor * nodes)


def errors_of(arm: kinseek.Arm, q: Array, targets: Array) -> tuple[Array, Array]:
    """Position errors [m] and the paper's orientation errors E_AX + E_AY, both (k,)."""
    poses = arm.fk(q)
    distance = np.linalg.norm(poses[:, :3, 3] - targets[:, :3, 3], axis=-1)
    turned = 2 - np.einsum("kij,kij->k", poses[:, :3, :2], targets[:, :3, :2])
    return np.asarray(distance), np.asarray(turned)


def _pieces(count: int, leaves: int) -> Iterator[slice]:
    size = max(1, _MOST_LEAVES // leaves)
    for first, end in pairwise([*range(0, count, size), count]):
        yield slice(first, end)


def _leaves(centre: Indices, shifts: Indices, count: int, ends: str, turns: NDArray[np.bool_]) -> Indices:
    """Every combination of nodes around each centre, (k, w^n, n)."""
    dof = centre.shape[1]
    nodes = centre[:, None, :] + shifts[None, :, None]
    if ends == "wrap":
        nodes %= count
    elif ends in ("clip", "turns wrap"):
        inside = np.where((nodes < 0) | (nodes >= count), centre[:, None, :], nodes)
        nodes = np.where(turns, nodes % count, inside) if ends == "turns wrap" else inside
    else:
        step = np.abs(np.diff(shifts)).max(initial=1)
        low, high = nodes.min(axis=1), nodes.max(axis=1)
        nodes = nodes + (np.where(low < 0, np.ceil(-low / step), 0) * step).astype(np.int64)[:, None]
        nodes = (
            nodes
            - (np.where(high >= count, np.ceil((high - count + 1) / step), 0) * step).astype(np.int64)[
                :, None
            ]
        )
        nodes = np.clip(nodes, 0, count - 1)
    choices = np.indices((len(shifts),) * dof).reshape(dof, -1)
    return np.stack([nodes[:, choices[joint], joint] for joint in range(dof)], axis=-1)


def _errors(arm: kinseek.Arm, q: Array, targets: Array, reading: Reading) -> Array:
    """The paper's error K_P · E_P + K_A · E_A of every leaf, (k, w^n)."""
    poses = arm.fk(q)
    error = reading.position_weight * np.linalg.norm(poses[..., :3, 3] - targets[:, None, :3, 3], axis=-1)
    if reading.orientation:
        axes = np.einsum("klij,kij->kl", poses[..., :3, :2], targets[:, :3, :2])
        error += reading.orientation_weight * (2 - axes)
    return np.asarray(error)
