"""A short part of the fuzz of maps; the long one is a command, see tests/fuzz/maps.py."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest

pytest.importorskip("xarray")
pytest.importorskip("zarr")

import fuzz.maps as fuzz_maps
from fuzz.maps import FINE, change_value, endings
from kinseek.maps import store

pytestmark = pytest.mark.slow

MAPS = 60


def test_a_damaged_map_gives_no_other_numbers() -> None:
    counts: Counter[str] = Counter()
    for number, told, found in endings(range(MAPS), 1):
        assert found in FINE, f"python -m tests.fuzz.maps --seed 1 --show {number}: {told}: {found}"
        counts[found] += 1
    assert min(counts["equal"], counts["refused"]) > MAPS / 20


def test_other_numbers_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    """If values were not compared with their checksums."""

    def unchecked(store: Any, name: str, block_id: Any) -> Any:
        return np.asarray(store._arrays[name][store._part(block_id)])

    monkeypatch.setattr(fuzz_maps, "DAMAGES", [change_value])
    monkeypatch.setattr(store.Store, "read", unchecked)
    assert "DIFFERENT" in {found.split()[0] for *_, found in endings(range(9), 1)}
