"""Data that is computed once for an arm and a kind of goal, before its branches can be found."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import freedom
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal
from kinseek.kernels.arm.forward import forward_many
from kinseek.kernels.arrays import Array
from kinseek.kernels.atlas.lanes import LANES
from kinseek.kernels.branches.refine_all import ANSWER
from kinseek.kernels.branches.search import ROWS, ArmTables, many_branches
from kinseek.kernels.branches.seeding import fill_steps
from kinseek.kernels.branches.twins import SHIFTS, SIGNS
from kinseek.kernels.structure.candidates import NONE, STRUCTURE
from kinseek.kinds import POSE, Kind
from kinseek.problem import Problem
from kinseek.robots.chain import SerialChain
from kinseek.solvers.atlas.index import MOST_CACHED, PLAIN, AtlasIndex, atlas_of, tolerances_of
from kinseek.support.caching import WeakCache
from kinseek.support.transforms import square
from kinseek.support.turns import shortest
from kinseek.virtual_joints import extended

from .one_joint import NOTHING, OneJoint, one_joint_of
from .result import Branches, quick_branches, solutions_of

SAMPLES = 1024
"""Samples of the coarse atlas; see `kernels.branches.search` for the reason for the small number."""


SAMPLE_SIZE = 50
"""Default number of solutions in a sample. Not examined further."""


GAP = 1.0
"""How much less than a full turn the range of a joint may be [rad] for the search from samples to ignore its limits. It is
nearly closed: its limits split the basins of solutions close to them, and a start at the wrong end of the range is stuck
there. Tried on a Panda and a Rizon 4 with one joint locked, 240,000 poses, half of them with a joint at a limit: the search
missed 510 solutions with limits, and 14 without. On fewer poses 1.5 and 2.5 missed none either, but took longer. The program
of this trial is not in the repository."""


_MOST_MIRRORED = 8
"""Largest number of joints for which mirror images are searched: there are 2ⁿ patterns of signs."""


class BranchIndex:
    """Data for finding the branches of one arm and one kind of goal: immutable, shared by threads."""

    def __init__(self, problem: Problem) -> None:
        """Sort coarse samples, compute the redundancy, and look for mirror images."""
        chain, kind = problem.chain, problem.goal.form
        self.freedom = freedom(problem)
        """Degree of redundancy: 0 for isolated solutions, 1 for curves of solutions, and so on."""
        self.fine = atlas_of(chain, problem.goal)
        middle, half = (chain.lower + chain.upper) / 2, (chain.upper - chain.lower) / 2
        turning = np.where(chain.periodic, 0.5 / np.pi, 0.0)
        self.view: Array = np.array([middle, 1 / np.maximum(half, 1e-12), turning])
        """Centre, scale and periodicity by which `kernels.branches` compares solutions: distances from the middle of each
        range, in halves of it, (3, n); see `refine_all.Metric`."""
        self.structure = self.fine.structure
        """Structure of the arm's geometry; `NO_STRUCTURE` if the goal is less than a pose."""
        joint = NOTHING
        # The search of one joint is slower than a closed form, so it is prepared for arms without one only.
        if kind is POSE and not self.freedom and STRUCTURE.value(self.structure.numbers).kind == NONE:
            joint = one_joint_of(problem.arrays, chain.length)
        self.coarse = AtlasIndex(
            chain, kind, problem.arrays, SAMPLES, structure=self.fine.structure, gap=self._gap(joint)
        )
        steps = np.zeros((0 if self.freedom else self.coarse.samples, 6, LANES))
        if not self.freedom:
            fill_steps(self.coarse.handle, steps, LANES)
        self.tables = ArmTables(
            handle=self.coarse.handle,
            fine=self.fine.handle,
            mirrors=np.zeros((0, 3, chain.dof)),
            structure=self.structure.numbers,
            joint=joint.numbers,
            table=joint.table,
            steps=steps,
        )
        """What `kernels.branches.search` takes of an arm; without steps for a redundant one."""
        if not self.freedom and chain.dof <= _MOST_MIRRORED:
            self.tables = self.tables._replace(mirrors=self._mirrors(problem))

    def _gap(self, joint: OneJoint) -> float:
        """See `GAP`; 0 for an arm whose geometry leads to the solutions."""
        searched = STRUCTURE.value(self.structure.numbers).kind == NONE and joint.table.shape[1] == 0
        return GAP if searched else 0.0

    def plain(self, chain: SerialChain, T: Array) -> Branches | None:
        """Return all solutions of one plain pose, (4, 4), without checks; None if it is not a rigid transform."""
        found = self.search(PLAIN, T, self.view, SAMPLE_SIZE)
        if not len(found):
            return None
        # The caller may write the next target into the same array.
        return quick_branches((chain, T.copy(), None), chain.dof, found, self.freedom > 0)

    def search(self, tolerances: Array, target: Array, view: Array, count: int) -> Array:
        """Return rows of solutions for one target, (4, 4), as `kernels.branches.search.many_branches` writes them."""
        assert count or not self.freedom, "a sample of the solutions of a redundant arm needs its size"
        most, number = (count, count) if self.freedom else (ROWS, 0)
        rows, found = np.empty((1, most + 1, view.shape[-1] + ANSWER)), np.empty(1, dtype=np.int64)
        many_branches(self.tables, tolerances, target[None], view[None], number, rows, found)
        return rows[0, : found[0]]

    def solutions(self, tolerances: Array, target: Array, count: int = 0) -> Array:
        """Return the solutions of one target, (3, 4), or `count` of them for a redundant arm, (k, n)."""
        rows = self.search(tolerances, square(target), self.view, count)
        return solutions_of(rows, self.view.shape[-1]).q if len(rows) else np.zeros((0, self.view.shape[-1]))

    def _mirrors(self, problem: Problem) -> Array:
        """Look for maps q → signs · q + shifts that leave every pose unchanged.

        Such a map takes a configuration to another branch of its own pose. So the branches of one pose yield all candidate
        shifts, and a second configuration decides which of them hold.
        """
        chain, dof = problem.chain, problem.chain.dof
        turns = chain.periodic
        signs = np.array(list(itertools.product((1.0, -1.0), repeat=dof)))
        tolerances, width = tolerances_of(Goal.pose(np.eye(4))), chain.upper - chain.lower
        # A fraction related to the golden ratio: no symmetric or otherwise special configuration.
        probe = chain.lower + 0.381966 * width
        pose = forward_many(problem.arrays, probe[None])[0]
        found: list[Array] = []
        # Whether the image of a configuration lies inside the limits depends on the configuration.
        for share in (0.45, 0.6, 0.7):
            q = chain.lower + share * np.linspace(0.9, 1.1, dof) * width
            target = forward_many(problem.arrays, q[None])[0]
            for other in self.solutions(tolerances, target[:3]):
                shifts = other - signs * q
                # Symmetries of revolute joints are half and full turns; the exact value removes the search's error.
                whole = np.round(shifts / np.pi) * np.pi
                shifts = np.where(turns & (np.abs(shifts - whole) < 1e-6), whole, shifts)
                reached = forward_many(problem.arrays, np.ascontiguousarray(signs * probe + shifts))
                for k in np.flatnonzero(np.abs(reached - pose).max(axis=(1, 2)) < 1e-9):
                    image = np.array([signs[k], shifts[k], turns])
                    shift = np.where(turns, shortest(shifts[k]), shifts[k])
                    itself = (signs[k] > 0).all() and np.abs(shift).max() < 1e-6
                    if not itself and not any(_same_image(image, known, turns) for known in found):
                        found.append(image)
        return np.array(found).reshape(-1, 3, dof)


def _same_image(one: Array, other: Array, turns: NDArray[np.bool_]) -> bool:
    apart = one[SHIFTS] - other[SHIFTS]
    apart = np.where(turns, shortest(apart), apart)
    return bool((one[SIGNS] == other[SIGNS]).all() and np.abs(apart).max() < 1e-6)


_Key = tuple[Kind, bytes | None]
"""Kind of goal, and the transform of the tip; None if there is none."""


_indices: WeakCache[SerialChain, _Key, BranchIndex] = WeakCache(MOST_CACHED, lambda key: key[1] is not None)


def index_of(problem: Problem) -> BranchIndex:
    """Return the index of an arm for a kind of goal: built at the first call, dropped with the arm.

    For goals with ranges it is that of the arm with virtual joints for them.

    The indices of the last `MOST_CACHED` tools and tool axes are kept.

    Raises:
        InvalidProblem: Branches of this kind of arm or goal are not supported.
    """
    goal = problem.goal
    if problem.axes is None:
        raise InvalidProblem(
            f"{problem.mechanism.name!r} has black-box kinematics: branches need the axes of an arm"
        )
    if goal.form.ranges:
        # What the first target of a batch leaves free, all of them do.
        first = [*goal.target.reshape(-1, 4, 4)[:1], np.eye(4)][0]
        return index_of(extended(problem.at(first)).problem)
    return _indices.of(problem.chain).get(goal.prepared_as, lambda: BranchIndex(problem))
