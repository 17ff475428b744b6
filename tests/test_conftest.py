"""One profile for every property test: no deadline, and a failure that can be had again."""

from __future__ import annotations

import ast
import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings


def test_no_example_is_timed_and_failures_print_how_to_get_them_again() -> None:
    now = settings()
    assert now.deadline is None
    assert HealthCheck.too_slow in now.suppress_health_check
    assert now.print_blob
    assert now.derandomize == bool(os.environ.get("CI"))


@pytest.mark.slow
def test_no_test_has_a_profile_of_its_own() -> None:
    looked_at = 0
    for path in Path(__file__).parent.rglob("test_*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "settings":
                looked_at += 1
                named = {keyword.arg for keyword in node.keywords}
                assert named <= {"max_examples", "suppress_health_check"}, f"{path.name}:{node.lineno}"
    assert looked_at > 10
