"""The result of `Arm.branches`: all distinct solutions of a goal, or a sample if there are infinitely many."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, Self, overload

import numpy as np
from numpy.typing import NDArray

from kinseek.derivatives import derivatives_of, null_spaces_of
from kinseek.kernels.atlas.task import ORIENTATION_ERROR, POSITION_ERROR
from kinseek.kernels.branches.refine_all import ANSWERS, CONTINUUM, SPENT
from kinseek.postures import configuration_of
from kinseek.problem import DeferredProblem, Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.named import by_name
from kinseek.support.lazy import Lazy, lazy

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Branches(Lazy):
    """The solutions of one goal, in the requested order; every one meets both tolerances.

    Errors are recomputed from `q` by plain forward kinematics. Without a solution `q` has no rows. The object is a sequence,
    so its truth value is that of a list: true if it has a solution.

    Attributes:
        q: Joint values inside the limits, (k, n), [rad] or [m]; no two are equal modulo 2π unless copies were requested.
        position_error: [m], (k,).
        orientation_error: [rad], (k,).
        complete: Whether it is proved that there is no other solution, except those that `valid` rejected. Only determined
            with ``prove=True``.
        sampled: Whether these are only a sample of infinitely many solutions. This is the case for redundant arms, and
            exactly at a singularity.
        evaluations: FK evaluations spent, the deterministic measure of work.
        rejected: Number of solutions that were removed because the user's `valid` rejected them or they collide in the
            `scene`.
        problem: The problem that was solved.
        out_of_time: Whether the time limit ended the search, or the proof, early.
        proved_blocked: Whether it is proved that every solution collides in the `scene`, so that none is left. Only
            determined with ``prove=True``.
    """

    q: Array
    position_error: Array
    orientation_error: Array
    complete: bool
    sampled: bool
    evaluations: int
    rejected: int
    if TYPE_CHECKING:
        problem: Problem
    else:
        problem: Problem = DeferredProblem()
    out_of_time: bool = False
    proved_blocked: bool = False

    def __len__(self) -> int:
        """Return the number of solutions."""
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        """Iterate over the solutions, (n,) each."""
        return iter(self.q)

    def __getitem__(self, index: int) -> Array:
        """Return the joint values of one solution, (n,)."""
        answer: Array = self.q[index]
        return answer

    @property
    def joints(self) -> dict[str, Array]:
        """Joint values by name, from base to tip; each holds one value per solution, (k,), [rad] or [m]."""
        return by_name(self.problem.mechanism.joint_names, self.q)

    @property
    def configuration(self) -> dict[str, Any]:
        """The posture of each solution by name, as `Solution.configuration`; every value has the shape (k,).

        Raises:
            InvalidUse: Postures of this arm have no names.
        """
        return configuration_of(self.problem.mechanism, self.q)

    @property
    def derivative(self) -> Array:
        """dq/dT of each solution, (k, n, 6), as `Solution.derivative`.

        Raises:
            InvalidUse: The goal has free axes or ranges.
        """
        return derivatives_of(self.problem, self.q, np.ones(len(self.q)))

    @property
    def null_space(self) -> Array:
        """Directions in which the joints of each solution move while the tip stays, (k, n, r), as `Solution.null_space`.

        Raises:
            InvalidUse: As `derivative`.
        """
        return null_spaces_of(self.problem, self.q, np.ones(len(self.q)))

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame`` with a row for each solution: joint values by name, then errors.

        Raises:
            MissingExtra: pandas is not installed.
        """
        from kinseek.tables import branches_table

        return branches_table(self).to_frame()

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the first solutions and a picture of them."""
        from kinseek.notebook.cards import branches_card

        return branches_card(self)

    def __repr__(self) -> str:
        """Return a short representation for a shell."""
        what = "a sample" if self.sampled else "complete" if self.complete else "not proved complete"
        refused = f", {self.rejected} rejected" if self.rejected else ""
        refused += ", proved blocked" if self.proved_blocked else ""
        count = "1 solution" if len(self) == 1 else f"{len(self)} solutions"
        return f"Branches({count}, {what}{refused}, q{self.q.shape})"


@dataclass(frozen=True, eq=False, repr=False)
class BranchesBatch(Sequence[Branches]):
    """The solutions of a batch of goals: a flat sequence of `Branches`, one per goal in C order.

    Goals have different numbers of solutions, so there is no rectangular array. `q` holds the solutions of all goals one
    after the other, and ``q[offsets[i]:offsets[i + 1]]`` are those of goal i. The truth value only depends on whether there
    are goals; `counts` gives the numbers of solutions.

    Attributes:
        each: The solutions, one `Branches` per goal; those that are requested in the order found are created on access.
        shape: Shape of the batch.
    """

    each: Sequence[Branches]
    shape: tuple[int, ...]

    @overload
    def __getitem__(self, index: int) -> Branches: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Branches]: ...
    def __getitem__(self, index: int | slice) -> Branches | Sequence[Branches]:
        """Return the solutions of one goal by its flat index, or those of several goals."""
        return self.each[index]

    def __len__(self) -> int:
        """Return the number of goals."""
        return len(self.each)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of solutions of each goal, in the shape of the batch."""
        counts = self.each.counts if isinstance(self.each, OfEachGoal) else [len(one) for one in self.each]
        return np.array(counts, dtype=np.int64).reshape(self.shape)

    @property
    def offsets(self) -> NDArray[np.int64]:
        """Index of the first solution of each goal in `q`, followed by the total number, (goals + 1,)."""
        return np.concatenate([[0], np.cumsum(self.counts.ravel())]).astype(np.int64)

    @property
    def q(self) -> Array:
        """Solutions of all goals, one after the other, (K, n), [rad] or [m]."""
        if not self.each:
            return np.zeros((0, 0))
        each = self.each.q if isinstance(self.each, OfEachGoal) else [one.q for one in self.each]
        return np.concatenate(each)

    def to_frame(self) -> Any:
        """Return a ``pandas.DataFrame`` with a row for each solution of each goal, indexed by goal and solution.

        Raises:
            MissingExtra: pandas is not installed.
            InvalidUse: The batch is empty, so the joints are not known.
        """
        from kinseek.tables import branches_batch_table

        return branches_batch_table(self).to_frame()

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: the numbers of solutions of the first goals."""
        from kinseek.notebook.cards import branches_batch_card

        return branches_batch_card(self)

    def __repr__(self) -> str:
        """Return a short representation for a shell."""
        counts = self.counts
        span = f"{counts.min()} to {counts.max()} solutions each" if counts.size else "empty"
        return f"BranchesBatch(shape={self.shape}, {span})"


class FoundRows(NamedTuple):
    """The solutions that the kernels found for one target."""

    q: Array
    """Joint values, (k, n)."""
    errors: Array
    """Position errors [m] and orientation errors [rad], (k, 2)."""
    evaluations: int
    singular: bool
    """Whether the search found a continuum of solutions."""


def solutions_of(rows: Array, dof: int) -> FoundRows:
    """Parse rows of solutions: joint values and errors; the last row holds their number and the cost of the search."""
    last = rows[-1]
    found = rows[: int(last[ANSWERS])]
    return FoundRows(found[:, :dof], found[:, dof : dof + 2], int(last[SPENT]), bool(last[CONTINUUM] > 0.0))


def quick_branches(
    question: tuple[SerialChain | Problem, Array, Array | None],
    dof: int,
    found: Array,
    sampled: bool,
    most: int | None = None,
) -> Branches:
    """Create the branches of one pose, in the order in which they were found, with little overhead.

    Args:
        question: The arguments from which `DeferredProblem` creates a problem.
        dof: Number of joint variables.
        found: Return value of `kernels.branches.search.find_branches`.
        sampled: Whether the arm is redundant.
        most: Largest number of solutions; None for all.
    """
    last = found[-1]
    count = int(last[ANSWERS])
    if most is not None:
        count = min(count, most)
    branches = object.__new__(Branches)
    branches.__dict__.update(
        q=found[:count, :dof],
        position_error=found[:count, dof + POSITION_ERROR],
        orientation_error=found[:count, dof + ORIENTATION_ERROR],
        complete=False,
        sampled=sampled or bool(last[CONTINUUM] > 0.0),
        evaluations=int(last[SPENT]),
        rejected=0,
        _question=question,
    )
    return branches


def late_branches(question: tuple[Problem, Array, Array | None], dof: int, sampled: bool) -> Branches:
    """Create the result for one pose that the time did not suffice for; see `quick_branches`."""
    nothing, branches = np.empty(0), object.__new__(Branches)
    branches.__dict__.update(
        q=np.empty((0, dof)),
        position_error=nothing,
        orientation_error=nothing,
        complete=False,
        sampled=sampled,
        evaluations=0,
        rejected=0,
        out_of_time=True,
        _question=question,
    )
    return branches


Found = Array | Branches | None
"""Solutions of one goal: as the kernels return them, see `kernels.branches.search.find_branches`; or ready; or None if the
time did not suffice."""


class OfEachGoal(Lazy, Sequence[Branches]):
    """The solutions of each goal of a batch; a `Branches` is created on access unless it is ready.

    If the arm has a closed form, creating a `Branches` takes as long as finding its solutions.
    """

    def __init__(
        self,
        problem: Problem,
        found: Sequence[Found],
        nears: Array | None,
        sampled: bool,
        most: int | None,
    ) -> None:
        """Store the results.

        Args:
            problem: The problem of a batch that is not empty.
            found: The solutions of each goal.
            nears: For each goal the joint values that its solutions are near to, (k, n), or None.
            sampled: Whether the arm is redundant.
            most: Largest number of solutions that kernels return; None for all.
        """
        self._one, self._targets = next(problem.each()), problem.goal.target.reshape(-1, 4, 4)
        self._found, self._nears, self._sampled, self._most = found, nears, sampled, most
        self._dof = problem.chain.dof

    @lazy
    def _made(self) -> dict[int, Branches]:
        """The solutions that were accessed."""
        return {}

    def __len__(self) -> int:
        """Return the number of goals."""
        return len(self._found)

    @overload
    def __getitem__(self, index: int) -> Branches: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Branches, ...]: ...
    def __getitem__(self, index: int | slice) -> Branches | tuple[Branches, ...]:
        """Return the solutions of one goal, the same object every time, or of several goals."""
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        i = range(len(self))[index]
        found = self._found[i]
        if isinstance(found, Branches):
            return found
        if i not in self._made:
            question = self._one, self._targets[i], None if self._nears is None else self._nears[i]
            if found is None:
                one = late_branches(question, self._dof, self._sampled)
            else:
                one = quick_branches(question, self._dof, found, self._sampled, self._most)
            self._made.setdefault(i, one)
        return self._made[i]

    def with_each(self, change: Callable[[Branches], Branches]) -> Self:
        """Return a copy in which a function has changed the `Branches` that are ready."""
        other = copy(self)
        other._found = [change(found) if isinstance(found, Branches) else found for found in self._found]
        return other

    @property
    def counts(self) -> list[int]:
        """Number of solutions of each goal."""
        return [self._count(found) for found in self._found]

    @property
    def q(self) -> list[Array]:
        """Solutions of each goal, (k, n), [rad] or [m]."""
        return [found.q if isinstance(found, Branches) else self._rows(found) for found in self._found]

    def _count(self, found: Found) -> int:
        if isinstance(found, Branches):
            return len(found)
        return (
            0 if found is None else int(min(found[-1, ANSWERS], np.inf if self._most is None else self._most))
        )

    def _rows(self, found: Array | None) -> Array:
        return np.empty((0, self._dof)) if found is None else found[: self._count(found), : self._dof]
