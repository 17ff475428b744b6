"""Collision-free solutions: branches in order of preference, more of the self-motion, then motion away from contacts."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinseek.branches.find import SEARCHING, branches_of
from kinseek.branches.index import SAMPLE_SIZE, BranchIndex, index_of
from kinseek.branches.order import Cost, ManyAtOnce, Preferred, Selection, Valid, is_valid
from kinseek.branches.prefer import preference_of, preferred, slide
from kinseek.branches.result import Branches, BranchesBatch, OfEachGoal
from kinseek.errors import InvalidScene
from kinseek.problem import Problem
from kinseek.proof.root_isolation import isolate
from kinseek.robots.mechanism import Mechanism
from kinseek.solution import Solution, conclude
from kinseek.solvers.atlas.solver import Atlas
from kinseek.support.deadline import Deadline

from .pairs import Contact
from .scene import Scene
from .shapes import length_or_zero

Array = NDArray[np.float64]

_MORE = (8, 20)
"""Sizes of further samples, as multiples of the first, if no solution of the first sample is free. Not examined further."""

_AT_ONCE = 16
"""Solutions checked in one call: eight fit into vector lanes, and most poses have at most sixteen."""

_ESCAPES = 3
"""Number of solutions that are moved away from contacts, the least colliding ones of the first `SAMPLE_SIZE`. Not examined
further."""


@dataclass
class Judge(ManyAtOnce):
    """Checks solutions one after the other for collisions and with the user's `valid`, and counts the rejected ones."""

    scene: Scene
    clearance: float
    valid: Valid | None = None
    blocked: int = 0
    refused: int = 0
    seen: list[Array] = field(default_factory=list)
    """Solutions that collide, (n,) each."""
    spared: Array | None = None
    """The first solution that is free of collision but that `valid` rejects, (n,)."""

    def __call__(self, q: Array) -> bool:
        """Return whether a solution is free of collision and `valid` accepts it."""
        return self._agrees(q, self.scene.free(q, self.clearance))

    def many(self, q: Array) -> NDArray[np.bool_]:
        """Do the same for several solutions, (k, n) -> (k,)."""
        free = self.scene.free(q, self.clearance)
        return np.array(
            [self._agrees(one, is_free) for one, is_free in zip(q, free, strict=True)], dtype=np.bool_
        )

    def first(self, candidates: Array) -> Array | None:
        """Return the first of some solutions, (k, n), that is free and accepted; several are checked in one call."""
        for begin in range(0, len(candidates), _AT_ONCE):
            some = candidates[begin : begin + _AT_ONCE]
            for q, free in zip(some, self.scene.free(some, self.clearance), strict=True):
                if self._agrees(q, free):
                    return np.asarray(q)
        return None

    def _agrees(self, q: Array, free: bool) -> bool:
        if not free:
            self.blocked += 1
            self.seen.append(q.copy())
            return False
        if self.valid is not None and not is_valid(self.valid, q):
            self.refused += 1
            self.spared = q.copy() if self.spared is None else self.spared
            return False
        return True


@dataclass
class _Pick:
    """The solution of one target."""

    q: Array
    evaluations: int
    success: bool
    """Free of collision and accepted. Also true if no solution was found, which the errors then show."""
    judge: Judge
    out_of_time: bool
    contacts: tuple[Contact, ...] = ()
    proved: bool = False
    """Is it proved that every solution collides?"""


def judge_of(scene: Any, mechanism: Mechanism, clearance: float, valid: Valid | None) -> Judge:
    """Validate a scene against an arm, and make the judge of solutions.

    Raises:
        InvalidScene: Not a scene, a scene of another arm or of this one with other joints locked, or an invalid clearance.
    """
    if not isinstance(scene, Scene):
        raise InvalidScene(
            f"scene must be a kinseek.Scene, got {type(scene).__name__}; make one: Scene.of(arm)"
        )
    if not scene.fits(mechanism):
        raise InvalidScene(
            f"this scene is of {scene.arm}, and not of {mechanism.name!r} with joints {', '.join(mechanism.joint_names)}: "
            "the joints, the lengths or the locked joints differ; make a scene of this arm: Scene.of(arm)"
        )
    return Judge(scene, length_or_zero("clearance", clearance), valid)


def free_solution(
    problem: Problem,
    scene: Scene,
    clearance: float,
    prefer: Preferred | None,
    cost: Cost | None,
    valid: Valid | None,
    threads: int | None,
    prove: bool = False,
) -> Solution:
    """Find collision-free solutions of every target; see `Arm.ik`.

    With `prove` it tries to prove that blocked targets are blocked. `Arm.ik` itself proves that targets are out of reach.

    Raises:
        InvalidScene: The scene belongs to another arm, or the clearance is invalid.
        InvalidProblem: As `preferred`.
    """
    judge_of(scene, problem.mechanism, clearance, valid)
    preference_of(problem, prefer, cost)
    deadline = Deadline(problem.time_limit)
    shape, count, dof = problem.goal.shape, len(problem.goal.targets), problem.chain.dof
    # What a target keeps that the time does not suffice for; it has not been checked for collisions.
    q = np.broadcast_to(problem.start, (*shape, dof)).reshape(-1, dof).copy()
    work, contacts = np.zeros((count, 3), dtype=np.int64), np.empty(count, dtype=object)
    for i in range(count):  # One by one: a tuple is a sequence, which NumPy would take apart.
        contacts[i] = ()
    refused, blocked = np.zeros((2, count), dtype=np.int64)
    success, proved = np.zeros((2, count), dtype=np.bool_)
    late = np.ones(count, dtype=np.bool_)
    for i, one in enumerate(problem.each()):
        if shape and deadline.passed:
            break
        judge = judge_of(scene, problem.mechanism, clearance, valid)
        pick = _pick(replace(one, time_limit=deadline.left), judge, prefer, cost, threads, deadline)
        if prove and pick.contacts:
            pick = _proved(one, pick, deadline)
        q[i], work[i, 0], late[i], contacts[i] = pick.q, pick.evaluations, pick.out_of_time, pick.contacts
        success[i], proved[i] = pick.success, pick.proved
        refused[i], blocked[i] = pick.judge.refused, pick.judge.blocked
    solution = conclude(problem, q, work, late)
    if not shape:
        return replace(
            solution,
            success=solution.success and bool(success[0]),
            rejected=int(refused[0]),
            blocked=int(blocked[0]),
            proved_blocked=bool(proved[0]),
            _contacts=contacts[0],
        )
    return replace(
        solution,
        success=solution.success & success.reshape(shape),
        rejected=refused.reshape(shape),
        blocked=blocked.reshape(shape),
        proved_blocked=proved.reshape(shape),
        _contacts=contacts.reshape(shape),
    )


def _pick(
    problem: Problem,
    judge: Judge,
    prefer: Preferred | None,
    cost: Cost | None,
    threads: int | None,
    deadline: Deadline,
) -> _Pick:
    """Choose the solution of one target."""
    index, spent = index_of(problem), 0
    if prefer is not None or cost is not None:
        # `preferred` checks its candidates, and slides along the self-motion as far as that is free.
        solution = preferred(problem, prefer, cost, judge, threads)
        spent += solution.evaluations
        if solution.success or not (judge.blocked or judge.refused):
            return _Pick(solution.q, spent, True, judge, solution.out_of_time)
    late, preference = False, preference_of(problem, prefer, cost)
    for many in (1, *_MORE) if index.freedom else (1,):
        if deadline.passed:
            late = True
            break
        # The counts and contacts that are reported refer to the last sample alone.
        judge.blocked, judge.refused, judge.seen, judge.spared = 0, 0, [], None
        selection = Selection(
            preference.order,
            cost,
            copies=preference.copies,
            count=many * SAMPLE_SIZE if many > 1 else None,
        )
        found = branches_of(replace(problem, time_limit=deadline.left), selection, threads)
        assert isinstance(found, Branches)  # True for one target.
        spent, candidates, late = spent + found.evaluations, found.q, found.out_of_time
        if not len(candidates):
            # The search for branches may miss a solution that the atlas finds.
            last = Atlas().solve(replace(problem, time_limit=deadline.left))
            spent += last.evaluations
            if not last.success:
                return _Pick(last.q, spent, True, judge, last.out_of_time)
            candidates = last.q[None]
        if (best := judge.first(preference.sorted(candidates))) is not None:
            return _Pick(best, spent, True, judge, late)
    return _escaped(problem, index, judge, spent, late, deadline)


def free_branches(
    problem: Problem, selection: Selection, scene: Scene, clearance: float, threads: int | None
) -> Branches | BranchesBatch:
    """Find every collision-free branch; see `Arm.branches`.

    Raises:
        InvalidScene: The scene belongs to another arm, or the clearance is invalid.
    """
    judge, deadline = (
        judge_of(scene, problem.mechanism, clearance, selection.valid),
        Deadline(problem.time_limit),
    )
    searching = deadline.share(SEARCHING) if selection.prove and problem.goal.shape else None
    found = branches_of(problem, replace(selection, valid=judge), threads, searching)
    if not selection.prove or not judge.blocked:
        return found

    def marked(one: Branches) -> Branches:
        if len(one) or not (one.complete and one.rejected) or one.problem.goal.form.ranges:
            return one
        if deadline.passed:
            return replace(one, out_of_time=True)
        _, blocked = all_blocked(one.problem, judge, deadline)
        return replace(one, proved_blocked=blocked, out_of_time=not blocked and deadline.passed)

    if isinstance(found, Branches):
        return marked(found)
    return replace(found, each=found.each.with_each(marked)) if isinstance(found.each, OfEachGoal) else found


def all_blocked(problem: Problem, judge: Judge, deadline: Deadline) -> tuple[Array | None, bool]:
    """Search for missing solutions, and prove that every solution collides.

    Around each solution of the complete set, a box contains all joint values that meet the tolerances (see
    `proof.root_isolation`). One pair of bodies is in contact everywhere in it.

    Returns:
        A free and accepted solution, (n,), or None; and whether it is proved that no free solution exists.
    """
    # The proof is about all solutions modulo whole turns, so the turns near some joint values do not matter.
    problem = replace(problem, near=None)
    found = branches_of(problem, Selection(), deadline=deadline)
    assert isinstance(found, Branches)
    isolation = isolate(problem, found.q, deadline=deadline)
    for q in problem.placed(isolation.q[isolation.given < 0]):
        if judge(q):
            return q, False
    each = zip(isolation.q, isolation.distance, strict=True)
    sure = isolation.complete and all(judge.scene.hits_around(q, d, judge.clearance) for q, d in each)
    return None, sure


def _proved(problem: Problem, pick: _Pick, deadline: Deadline) -> _Pick:
    """Prove that a target is blocked, or find the solution that the search missed."""
    if index_of(problem).freedom or problem.goal.form.ranges:
        return pick
    found, proved = all_blocked(problem, pick.judge, deadline)
    if found is not None:
        return replace(pick, q=found, success=True, contacts=())
    return replace(pick, proved=proved, out_of_time=pick.out_of_time or (not proved and deadline.passed))


def _escaped(
    problem: Problem, index: BranchIndex, judge: Judge, spent: int, late: bool, deadline: Deadline
) -> _Pick:
    """If no solution is free and accepted, move the least colliding ones away from their contacts."""
    scene, blocked = judge.scene, np.array(judge.seen[:SAMPLE_SIZE]).reshape(-1, problem.chain.dof)
    if judge.spared is not None or not len(blocked):
        return _Pick(problem.start if judge.spared is None else judge.spared, spent, False, judge, late)
    # The solution that penetrates least is probably the one with the shortest way to a free one.
    order = np.argsort(-scene.distance(blocked), kind="stable")
    best = blocked[order[0]]
    for q in blocked[order[:_ESCAPES]] if index.freedom else ():
        if deadline.passed:
            late = True
            break
        way = slide(problem, index, q, lambda many: -np.asarray(scene.distance(many)), None, deadline)
        spent += way.evaluations
        if judge(way.q):
            return _Pick(way.q, spent, True, judge, late)
        if way.cost < -scene.distance(best):
            best = way.q
    return _Pick(best, spent, False, judge, late, scene.hits(best, judge.clearance))
