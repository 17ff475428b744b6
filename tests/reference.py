"""Slow, plain NumPy twins of the kernels: no Numba, no sharing of prefixes, no tables."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from kinseek.goal import Goal
from kinseek.robots.chain import SerialChain

Array = NDArray[np.float64]


def fk(chain: SerialChain, q: Sequence[float] | Array) -> Array:
    """``A_1 J_1 A_2 J_2 … A_m J_m A_tip``, (4, 4)."""
    T = np.eye(4)
    for k in range(len(chain.prismatic)):
        value = chain.multiplier[k] * q[chain.leader[k]] + chain.offset[k]
        J = np.eye(4)
        if chain.prismatic[k]:
            J[2, 3] = value
        else:
            c, s = np.cos(value), np.sin(value)
            J[:2, :2] = [[c, -s], [s, c]]
        T = T @ _square(chain.fixed[k]) @ J
    return np.asarray(T @ _square(chain.fixed[-1]))


def _square(A: Array) -> Array:
    square = np.eye(4)
    square[:3] = A
    return square


def weighted_error(T: Array, goal: Goal, target: Array | None = None) -> float:
    """The paper's K_P E_P + K_A E_A (Sec. 2.2); for a pointing goal E_A has the tool axis alone."""
    G = goal.target if target is None else target
    position = goal.position_weight * float(np.linalg.norm(T[:3, 3] - G[:3, 3]))
    axes = {"pose": np.eye(3)[:2], "pointing": np.array([goal.tool_axis]), "position": np.empty((0, 3))}[
        goal.kind
    ]
    # 1 - x·x_g is ½ |x - x_g|² for unit vectors, and does not cancel so.
    turned = sum(float(((T[:3, :3] @ axis - G[:3, :3] @ axis) ** 2).sum()) / 2.0 for axis in axes)
    return position + goal.orientation_weight * turned


def errors(T: Array, goal: Goal, target: Array | None = None) -> tuple[float, float]:
    """Position error [m] and orientation error [rad]."""
    G = goal.target if target is None else target
    position = float(np.linalg.norm(T[:3, 3] - G[:3, 3]))
    if goal.kind == "position":
        return position, 0.0
    if goal.kind == "pointing":
        a, b = T[:3, :3] @ goal.tool_axis, G[:3, :3] @ goal.tool_axis
        return position, float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
    return position, float(Rotation.from_matrix(T[:3, :3].T @ G[:3, :3]).magnitude())


def chordal_error(T: Array, goal: Goal) -> float:
    """``(K_P |p - p_g|)² + K_A²/2 |R - R_g|²_F``, for a pose."""
    turn = float(((T[:3, :3] - goal.target[:3, :3]) ** 2).sum())
    place = float(((T[:3, 3] - goal.target[:3, 3]) ** 2).sum())
    return goal.position_weight**2 * place + goal.orientation_weight**2 / 2 * turn


def node_values(chain: SerialChain, size: int, nodes: Sequence[Sequence[int]]) -> list[list[float]]:
    """Values of nodes, one list a joint: ends included unless both are the same pose."""
    values = []
    for d, row in enumerate(nodes):
        cells = size if chain.wraps[d] else max(size - 1, 1)
        step = (chain.upper[d] - chain.lower[d]) / cells
        values.append([float(min(chain.lower[d] + step * node, chain.upper[d])) for node in row])
    return values


@dataclass
class Exhaustive:
    """The best leaf of a small grid, the last joint fastest, and how many nodes it took."""

    error: float
    nodes: tuple[int, ...]
    q: tuple[float, ...]
    leaves: int
    expanded: int


def exhaustive(chain: SerialChain, goal: Goal, size: int, nodes: Sequence[Sequence[int]]) -> Exhaustive:
    """Try every leaf; of equal ones the first counts."""
    values = node_values(chain, size, nodes)
    best = Exhaustive(np.inf, (), (), 0, 0)
    for choice in product(*(range(len(row)) for row in nodes)):
        q = tuple(values[d][i] for d, i in enumerate(choice))
        error = weighted_error(fk(chain, q), goal)
        best.leaves += 1
        if error < best.error:
            best.error, best.q, best.nodes = error, q, tuple(nodes[d][i] for d, i in enumerate(choice))
    best.expanded = int(sum(np.prod([len(row) for row in nodes[: d + 1]]) for d in range(len(nodes))))
    return best


@dataclass
class PaperSearch:
    """Algorithms 1 and 2 of the paper, its global variables as attributes.

    Departures, the same as in kinseek: a joint that does not turn fully gets both limits, the middles of D
    equal cells at first, and windows that slide inward at a limit; the last spacing is always 1.
    """

    chain: SerialChain
    goal: Goal
    branching_factor: int
    divisions: int
    breadth: Sequence[int]
    best_error: float = np.inf
    best_assignment: tuple[int, ...] | None = None
    expanded: int = 0
    assignment: list[int] = field(default_factory=list)
    pass_best: tuple[int, ...] | None = None
    tie: float = 0.0
    """A leaf is better only if its error is less by more than this."""

    def solve(self) -> PaperSearch:
        """Algorithm 2."""
        spacing = max(self.branching_factor // self.divisions, 1)
        while True:
            self.pass_best = self.best_assignment
            self.recursive_depth_search(spacing)
            if spacing == 1:
                return self
            spacing = max(spacing // self.divisions, 1)

    def recursive_depth_search(self, spacing: int) -> None:
        """Algorithm 1."""
        joint = len(self.assignment)
        if joint == self.chain.dof:
            rows = [[node] for node in self.assignment]
            q = [row[0] for row in node_values(self.chain, self.branching_factor, rows)]
            error = weighted_error(fk(self.chain, q), self.goal)
            if error < self.best_error - self.tie:
                self.best_error, self.best_assignment = error, tuple(self.assignment)
            return
        for node in self.subqueue(joint, spacing):
            self.expanded += 1
            self.assignment.append(node)
            self.recursive_depth_search(spacing)
            self.assignment.pop()

    def subqueue(self, joint: int, spacing: int) -> Iterator[int]:
        """D nodes over the whole range at first, then 2(⌊D/2⌋ + Br) - 1 around the best so far."""
        B, D, wraps = self.branching_factor, self.divisions, bool(self.chain.wraps[joint])
        if self.pass_best is None:
            count = min(B, D)
            yield from (i * B // count if wraps else (2 * i + 1) * B // (2 * count) for i in range(count))
            return
        count = min(2 * (D // 2 + self.breadth[joint]) - 1, B, (B - 1) // spacing + 1)
        centre = self.pass_best[joint]
        steps = np.arange(count) - count // 2
        if wraps:
            yield from (int(centre + i * spacing) % B for i in steps)
            return
        while centre + steps[0] * spacing < 0:
            steps += 1
        while centre + steps[-1] * spacing >= B and centre + (steps[0] - 1) * spacing >= 0:
            steps -= 1
        yield from (int(centre + i * spacing) for i in steps if centre + i * spacing < B)
