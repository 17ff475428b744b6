"""The README's speed table is that of the page that is kept of the last run."""

from __future__ import annotations

from benchmarks.field.page import SPEED
from benchmarks.speed_table import README, updated


def test_the_readme_shows_the_last_run() -> None:
    text = README.read_text(encoding="utf-8")
    assert updated(text, SPEED.read_text(encoding="utf-8")) == text
