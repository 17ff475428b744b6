"""Messages about unknown names suggest others, and take no longer for names that were made to take long."""

from __future__ import annotations

import difflib
import pickle
from typing import Any

import pytest

from kinseek.errors import MissingExtra, near_names, reason, suggest, unknown


def test_similar_names_are_suggested() -> None:
    assert suggest("ur5", ["ur5e", "ur3e", "panda"], "robot") == (
        "unknown robot 'ur5'; did you mean 'ur5e' or 'ur3e'? Valid: panda, ur3e, ur5e"
    )
    assert suggest("x", [], "robot") == "unknown robot 'x'. Valid: none"
    assert suggest("x Valid:", ["panda"], "robot") == "unknown robot 'x Valid:'. Valid: panda"
    assert unknown("Panda", ["panda", "pandb"], "robot") == "unknown robot 'Panda'; did you mean 'panda'?"


def test_of_many_names_those_of_a_similar_length_are_compared() -> None:
    names = [f"{'l' * length}{i}" for length in (2, 60) for i in range(1000)]
    assert near_names("gripper", [*names, "grippers"]) == ["grippers"]


def test_long_names_and_many_names_are_not_compared(monkeypatch: pytest.MonkeyPatch) -> None:
    compared: list[str] = []
    matches = difflib.get_close_matches

    def counted(word: str, names: list[str], **options: Any) -> list[str]:
        compared.extend([word, *names])
        return matches(word, names, **options)

    monkeypatch.setattr(difflib, "get_close_matches", counted)
    names = [f"{i}{'l' * (i % 400)}" for i in range(10_000)]
    assert near_names("k" * 2000, [*names, "k" * 1999]) == []
    assert near_names("k" * 100, [*names, "k" * 101]) == []
    near_names("l" * 100, names)
    assert 0 < len(compared) <= 2 * 201
    assert max(map(len, compared)) <= 100


def test_errors_can_be_pickled() -> None:
    """One that a process for reading files raised ended in a TypeError in the other process."""
    one = MissingExtra("this", "that")
    again = pickle.loads(pickle.dumps(one))
    assert (type(again), str(again), again.extra) == (MissingExtra, str(one), "that")


def test_an_error_without_a_message_is_called_by_its_type() -> None:
    assert reason(ValueError("no")) == "no"
    assert reason(MemoryError()) == "MemoryError"
    assert reason(ValueError("x" * 10), most=3) == "xxx"
