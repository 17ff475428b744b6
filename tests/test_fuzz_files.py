"""A short part of the fuzz of files; the long one is a command, see tests/fuzz/files.py."""

from __future__ import annotations

import time
from collections import Counter

import pytest

from fuzz.files import MUTATIONS, Case, case, findings, judge, seeds, write

pytestmark = pytest.mark.slow

SECONDS = 10.0


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


@pytest.mark.parametrize("suffix", [".urdf", ".xacro", ".xml"])
def test_sound_files_load(suffix: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    if suffix == ".xml":
        pytest.importorskip("mujoco")
    sound = next(seed for seed in seeds() if seed.suffix == suffix)
    beside = case(0, 0, [sound]).beside
    assert (
        judge(write(tmp_path_factory.mktemp("sound"), Case("case" + suffix, sound.text, beside))) == "loaded"
    )


def test_every_mutation_changes_some_file() -> None:
    from random import Random

    texts = [seed.text for seed in seeds()]
    for mutate in MUTATIONS:
        random = Random(0)
        assert any(mutate(random, text) != text for text in texts[:5] * 4), mutate.__name__
