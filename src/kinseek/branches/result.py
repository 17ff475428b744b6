"""What `Arm.branches` brings back: all distinct answers to a goal, or a sample of them where there are endlessly many."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple, overload

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.atlas.task import ORIENTATION_ERROR, POSITION_ERROR
from kinseek.kernels.branches.refine_all import ANSWERS, CONTINUUM, SPENT
from kinseek.lazy import Lazy, lazy
from kinseek.problem import MadeWhenAsked, Problem
from kinseek.robots.chain import SerialChain
from kinseek.robots.named import by_name

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class Branches(Lazy):
    """The answers to one goal, in the order that was asked for; every one meets both tolerances.

    Errors are recomputed from `q` by plain forward kinematics. Without an answer `q` has no rows. It is a sequence, so it
    is true as a list is: where there is an answer.

    Attributes:
        q: Joint values inside the limits, (k, n), [rad] or [m]; no two are equal modulo 2π unless copies were asked for.
        position_error: [m], (k,).
        orientation_error: [rad], (k,).
        complete: Is it proved that there is no other answer, but for those that `valid` refused? Only ``prove=True`` can
            tell.
        sampled: Are these only a sample of endlessly many? So it is with joints to spare, and exactly at a singularity.
        evaluations: FK evaluations spent, the deterministic measure of work.
        rejected: How many answers the user's `valid` refused, or hit something in the `scene`; they are left out.
        problem: What was asked.
        out_of_time: Did the time limit end the search, or the proof, before it was done?
        proved_blocked: Is it proved that there are no answers here because every one hits something in the `scene`? Only
            ``prove=True`` can tell.
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
        problem: Problem = MadeWhenAsked()
    out_of_time: bool = False
    proved_blocked: bool = False

    def __len__(self) -> int:
        """Return the number of answers."""
        return len(self.q)

    def __iter__(self) -> Iterator[Array]:
        """Joint values of one answer after the other, (n,) each."""
        return iter(self.q)

    def __getitem__(self, index: int) -> Array:
        """Joint values of one answer, (n,)."""
        answer: Array = self.q[index]
        return answer

    @property
    def joints(self) -> dict[str, Array]:
        """Joint values by name, base to tip: of each one value an answer, (k,), [rad] or [m]."""
        return by_name(self.problem.mechanism.joint_names, self.q)

    def to_frame(self) -> Any:
        """A ``pandas.DataFrame``: a row for each answer; its joint values by name, then its errors.

        Raises:
            MissingExtra: pandas is not installed.
        """
        from kinseek.notebook.frames import branches_frame

        return branches_frame(self)

    def _repr_html_(self) -> str:
        """For notebooks: the first answers, and a picture of these."""
        from kinseek.notebook.cards import branches_card

        return branches_card(self)

    def __repr__(self) -> str:
        """Short enough to print in a shell."""
        what = "a sample" if self.sampled else "complete" if self.complete else "not proved complete"
        refused = f", {self.rejected} rejected" if self.rejected else ""
        refused += ", proved blocked" if self.proved_blocked else ""
        return f"Branches({len(self)} answers, {what}{refused}, q{self.q.shape})"


@dataclass(frozen=True, eq=False, repr=False)
class BranchesBatch(Sequence[Branches]):
    """The answers to a batch of goals: a flat sequence of `Branches`, one a goal in C order.

    Goals have different numbers of answers, so there is no rectangular array. `q` holds the answers of all goals one
    after the other, and ``q[offsets[i]:offsets[i + 1]]`` are those of goal i. It is true where there is a goal; whether
    there are answers, `counts` says.

    Attributes:
        each: The answers, one `Branches` a goal; where they are wanted as they were found, made when they are looked at.
        shape: Shape of the batch.
    """

    each: Sequence[Branches]
    shape: tuple[int, ...]

    @overload
    def __getitem__(self, index: int) -> Branches: ...
    @overload
    def __getitem__(self, index: slice) -> Sequence[Branches]: ...
    def __getitem__(self, index: int | slice) -> Branches | Sequence[Branches]:
        """Return the answers to one goal by its flat number, or those to some."""
        return self.each[index]

    def __len__(self) -> int:
        """Return the number of goals."""
        return len(self.each)

    @property
    def counts(self) -> NDArray[np.int64]:
        """Number of answers to each goal, of the batch's shape."""
        counts = self.each.counts if isinstance(self.each, AsFound) else [len(one) for one in self.each]
        return np.array(counts, dtype=np.int64).reshape(self.shape)

    @property
    def offsets(self) -> NDArray[np.int64]:
        """Where the answers to each goal begin in `q`, and their number at the end, (goals + 1,)."""
        return np.concatenate([[0], np.cumsum(self.counts.ravel())]).astype(np.int64)

    @property
    def q(self) -> Array:
        """Answers of all goals, one after the other, (K, n), [rad] or [m]."""
        if not self.each:
            return np.zeros((0, 0))
        return np.concatenate(self.each.q if isinstance(self.each, AsFound) else [one.q for one in self.each])

    def to_frame(self) -> Any:
        """A ``pandas.DataFrame``: a row for each answer to each goal, called by the goal's flat number and its own.

        Raises:
            MissingExtra: pandas is not installed.
            InvalidUse: A batch of no goals, which tells no joints.
        """
        from kinseek.notebook.frames import branches_batch_frame

        return branches_batch_frame(self)

    def _repr_html_(self) -> str:
        """For notebooks: how many answers the first goals have."""
        from kinseek.notebook.cards import branches_batch_card

        return branches_batch_card(self)

    def __repr__(self) -> str:
        """Short enough to print in a shell."""
        counts = self.counts
        span = f"{counts.min()} to {counts.max()} answers each" if counts.size else "empty"
        return f"BranchesBatch(shape={self.shape}, {span})"


class Answers(NamedTuple):
    """What the kernels found for one target."""

    q: Array
    """(k, n)"""
    errors: Array
    """Position errors [m] and orientation errors [rad], (k, 2)."""
    evaluations: int
    singular: bool
    """Did the search meet endlessly many answers?"""


def answers_of(rows: Array, dof: int) -> Answers:
    """Name what stands in rows of answers: joint values and errors, and in the last row how many, at what cost."""
    last = rows[-1]
    found = rows[: int(last[ANSWERS])]
    return Answers(found[:, :dof], found[:, dof : dof + 2], int(last[SPENT]), bool(last[CONTINUUM] > 0.0))


def quick_branches(
    question: tuple[SerialChain | Problem, Array, Array | None],
    dof: int,
    found: Array,
    sampled: bool,
    most: int | None = None,
) -> Branches:
    """Make branches of one pose, in the order in which they were found, as fast as Python can.

    Args:
        question: What `MadeWhenAsked` makes a problem of.
        dof: Joint variables.
        found: What `kernels.branches.search.find_branches` returns.
        sampled: Does the arm have joints to spare?
        most: So many answers at most; None for all.
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


class AsFound(Lazy, Sequence[Branches]):
    """The answers to each goal of a batch in the order in which they were found; a `Branches` is made when it is looked at.

    To make one takes as long as to find its answers where the arm has a closed form.
    """

    def __init__(
        self, problem: Problem, found: list[Array], nears: Array | None, sampled: bool, most: int | None
    ) -> None:
        """Keep what was found.

        Args:
            problem: The question, of a batch that is not empty.
            found: Of each goal what `kernels.branches.search.find_branches` returns.
            nears: Of each goal what its answers are near to, (k, n), or None.
            sampled: Does the arm have joints to spare?
            most: So many answers at most; None for all.
        """
        self._one, self._targets = next(problem.each()), problem.goal.target.reshape(-1, 4, 4)
        self._found, self._nears, self._sampled, self._most = found, nears, sampled, most
        self._dof = problem.chain.dof

    @lazy
    def _made(self) -> dict[int, Branches]:
        """The answers that were looked at."""
        return {}

    def __len__(self) -> int:
        """How many goals there are."""
        return len(self._found)

    @overload
    def __getitem__(self, index: int) -> Branches: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[Branches, ...]: ...
    def __getitem__(self, index: int | slice) -> Branches | tuple[Branches, ...]:
        """The answers to one goal, the same object every time, or to some."""
        if isinstance(index, slice):
            return tuple(self[i] for i in range(*index.indices(len(self))))
        i = range(len(self))[index]
        if i not in self._made:
            question = self._one, self._targets[i], None if self._nears is None else self._nears[i]
            one = quick_branches(question, self._dof, self._found[i], self._sampled, self._most)
            self._made.setdefault(i, one)
        return self._made[i]

    @property
    def counts(self) -> list[int]:
        """Number of answers to each goal."""
        most = np.inf if self._most is None else self._most
        return [int(min(rows[-1, ANSWERS], most)) for rows in self._found]

    @property
    def q(self) -> list[Array]:
        """Answers to each goal, (k, n), [rad] or [m]."""
        return [rows[:count, : self._dof] for rows, count in zip(self._found, self.counts, strict=True)]
