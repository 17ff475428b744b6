"""The page of the benchmark of all solvers: where others do better, and what is not measured."""

from __future__ import annotations

import numpy as np
import pandas as pd

from benchmarks.field.page import _why
from benchmarks.field.tables import marked
from benchmarks.field.wins import wins

NAMES = {"kinseek": "kinseek", "one": "One", "two": "Two"}
NO_FACTS = pd.DataFrame({"first": [], "memory": [], "megabytes": []})


def answered(
    solver: str,
    question: str = "random",
    *,
    count: int = 100,
    exact: int = 100,
    microseconds: float = 10.0,
    arm: str = "panda",
    error: float = 1e-4,
    claimed: bool = True,
) -> pd.DataFrame:
    """Answers of which the first are exact and the others off by an error [m]; times rise by a thousandth each."""
    return pd.DataFrame(
        {
            "solver": solver,
            "settings": "best",
            "arm": arm,
            "question": question,
            "target": np.arange(count),
            "part": np.arange(count) // 10,
            "microseconds": microseconds * (1.0 + np.arange(count) / 1000.0),
            "relative": microseconds / 10.0 * (1.0 + np.arange(count) / 1000.0),
            "claimed": pd.array([claimed] * count, dtype="boolean"),
            "position_error": np.where(np.arange(count) < exact, 1e-9, error),
            "orientation_error": 0.0,
            "outside": 0.0,
        }
    )


def won(*parts: pd.DataFrame, branches: pd.DataFrame | None = None) -> list[str]:
    return wins(marked(pd.concat(parts, ignore_index=True)), NO_FACTS, NAMES, branches)


def test_who_solves_more_or_is_quicker_or_has_a_shorter_tail_is_named() -> None:
    assert won(answered("kinseek"), answered("one", microseconds=20.0)) == []
    assert won(answered("kinseek", exact=80), answered("one", microseconds=20.0)) == [
        "**Random poses**, more solved exactly: One (best) on 1 of 1 arm (panda)."
    ]
    quicker = won(answered("kinseek"), answered("one", microseconds=5.0), answered("two", microseconds=6.0))
    assert quicker == [
        "**Random poses**, quicker and no fewer solved exactly: One (best) 0.52 × kinseek's time on 1 of 1 arm "
        "(panda); Two (best) 0.63 × kinseek's time on 1 of 1 arm (panda)."
    ]
    many = [
        answered(solver, count=3000, exact=3000, microseconds=t)
        for solver, t in (("kinseek", 10.0), ("one", 5.0))
    ]
    assert any("a shorter tail" in each for each in won(*many)), (
        "with three thousand the last hundredth is known"
    )


def test_quick_and_wrong_is_no_better_and_within_a_millimetre_is_said_to_be_that() -> None:
    assert won(answered("kinseek"), answered("one", exact=50, microseconds=5.0, error=1.0)) == []
    (said,) = won(answered("kinseek"), answered("one", exact=0, microseconds=5.0))
    assert said.startswith("**Random poses**, quicker and no fewer solved within 1 mm: One (best)")


def test_out_of_reach_counts_who_says_so_and_who_is_nearer() -> None:
    ours = answered("kinseek", "unreachable", exact=0, error=1.01, claimed=False)
    liar = answered("one", "unreachable", exact=0, error=1.00, microseconds=5.0)
    (said,) = won(ours, liar)
    assert said == (
        "**Out of reach**, a nearer position: One (best) 0 % farther than the nearest known against 1, "
        "with any orientation."
    )
    (said,) = won(ours, answered("one", "unreachable", exact=0, error=2.0, microseconds=5.0, claimed=False))
    assert said.startswith("**Out of reach**, quicker: One (best) 0.52 × kinseek's time")


def test_every_answer_is_of_those_found_and_no_share() -> None:
    both = answered("kinseek", "branches"), answered("one", "branches", microseconds=5.0)

    def found(ours: int, theirs: int) -> pd.DataFrame:
        rows = [("kinseek", ours), ("one", theirs)]
        return pd.DataFrame(
            [{"solver": s, "arm": "panda", "target": 0, "found": n, "known": 8} for s, n in rows]
        )

    assert won(*both, branches=found(8, 1)) == [], "quick at one of eight"
    more, quicker, *_ = won(*both, branches=found(7, 8))
    assert more == "**Every answer**, finds more of all answers: One (best) on 1 of 1 arm (panda)."
    assert "quicker" in quicker


def test_what_kinseek_calls_a_success_and_is_none_stands_first() -> None:
    said = won(answered("kinseek", exact=98, error=1.0))
    assert said == ["**False successes** of kinseek: random poses 2."]


def test_states_are_told_without_what_differs_from_arm_to_arm() -> None:
    assert _why("hangs: nothing for 12 s") == _why("hangs: nothing for 13 s") == "hangs"
    assert (
        _why("15 of 40 in 0.6 s") == _why("3 of 20 in 0.2 s") == "time was up before every target was asked"
    )
    assert _why("ends with 1: Failure at some/file.cc") == "the process ends with 1"
    assert _why("revolute joints only") == "revolute joints only"
