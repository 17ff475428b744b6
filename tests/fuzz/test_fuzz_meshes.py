"""A short part of the fuzz of meshes; the long one is a command, see tests/fuzz/meshes.py."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

pytest.importorskip("trimesh")

from fuzz.judges import JUDGES
from fuzz.mesh_makers import MAKERS
from fuzz.meshes import FINE, case, compared, endings

pytestmark = pytest.mark.slow

FILES = 150


@pytest.mark.parametrize("kind", MAKERS)
def test_a_mesh_is_refused_or_has_the_shape_of_its_file(kind: str) -> None:
    found = list(endings(FILES, 1, [kind]))
    for number, _, ending in found:
        assert ending in FINE, f"python -m tests.fuzz.meshes --kind {kind} --seed 1 --show {number}: {ending}"
    counts = Counter(ending for *_, ending in found)
    assert min(counts["equal"], counts["refused"]) > FILES / 10


@pytest.mark.parametrize("kind", MAKERS)
def test_judges_know_every_file_without_mutations(kind: str) -> None:
    for number in range(200):
        _, mutations, text = case(number, 2, [kind])
        if not mutations:
            assert JUDGES[kind](text)


def test_another_shape_is_seen() -> None:
    one = np.random.default_rng(0).normal(size=(4, 3, 3))
    assert compared(one, list(one)) == "equal"
    assert compared(one[::-1, [1, 2, 0]], list(one)) == "equal"
    assert compared(one[:, ::-1], list(one)) == "TURNED"
    assert compared(one[:3], list(one)) == "DIFFERENT"
    assert compared(one, list(one[:3])) == "DIFFERENT"
    assert compared(one * (1 + 1e-7), list(one)) == "DIFFERENT"
    assert compared(np.concatenate([one[:3], one[:1]]), list(one)) == "DIFFERENT"


def test_a_polygon_may_be_divided_from_any_corner_that_sees_the_others() -> None:
    ring = np.array([[0, 0, 0], [2, 0, 0], [2, 1, 0], [1, 1, 0], [1, 2, 0], [0, 2, 0]], float)

    def divided(first: int) -> str:
        turned = np.roll(ring, -first, axis=0)
        return compared(np.array([turned[[0, k, k + 1]] for k in range(1, 5)]), [ring])

    assert [divided(first) for first in range(6)] == [
        "equal",
        *["DIFFERENT"] * 2,
        "equal",
        *["DIFFERENT"] * 2,
    ]
