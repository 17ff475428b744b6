"""A short part of the fuzz of files; the long one is a command, see tests/fuzz/files.py."""

from __future__ import annotations

import time
from collections import Counter

import pytest

from fuzz.files import case, findings, seeds
from fuzz.mutations import OF_OTHERS, OF_XML
from fuzz.readers import READERS

pytestmark = pytest.mark.slow

SECONDS = 4.0


def test_mutated_files_end_in_an_arm_or_in_a_kinseek_error() -> None:
    begin, endings = time.monotonic(), Counter[str]()
    for number, _, result in findings(0, 10**6, 1, None):
        assert result in ("loaded", "refused"), (
            f"python -m tests.fuzz.files --seed 1 --show {number}: {result}"
        )
        endings[result] += 1
        if time.monotonic() - begin > SECONDS and endings["loaded"]:
            break
    assert endings["refused"]


def test_a_case_is_always_the_same_file() -> None:
    from_ = seeds()
    assert [case(i, 3, from_) for i in range(20)] == [case(i, 3, from_) for i in range(20)]
    assert len({case(i, 3, from_).text for i in range(40)}) > 20


def test_every_mutation_changes_some_file() -> None:
    from random import Random

    from_ = seeds()
    assert set(from_) == set(READERS)
    for mutations, texts in (
        (OF_XML, from_[".urdf"][:5] * 4),
        (OF_OTHERS, from_[".dh.json"] + from_[".csv"]),
    ):
        for mutate in mutations:
            random = Random(0)
            assert any(mutate(random, text) != text for text in texts), mutate.__name__
