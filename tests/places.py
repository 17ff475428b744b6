"""Folders that tests read: the repository, and the robots beside it."""

from __future__ import annotations

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHARED = ROOT.parent / "shared" / "robots"
"""Robot files that are not part of the repository; tests that need them skip where they are missing."""
