"""The README's speed table is that of the last run against the peers."""

from __future__ import annotations

from benchmarks.speed_table import PEERS, README, updated


def test_the_readme_shows_the_last_run_against_the_peers() -> None:
    text = README.read_text(encoding="utf-8")
    assert updated(text, PEERS.read_text(encoding="utf-8")) == text
