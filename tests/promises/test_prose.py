"""The check of English finds the sentences that made readers stop, and accepts what they became."""

from __future__ import annotations

import runpy
from pathlib import Path

import pytest

from places import ROOT

pytest.importorskip("proselint")
if not (ROOT / "docs").exists():
    pytest.skip("only the wheel is here", allow_module_level=True)
PROSE = runpy.run_path(str(ROOT / "docs" / "prose.py"))

STOPPED = (
    "A missed tolerance is a status and is no exception.",
    "The machine was slow that day.",
    "Both are timed by turns.",
    "Refused are ranges about two axes without any about the third.",
    "Proved is the one on which the joints go straight.",
    "It is left out if nothing can lack.",
    "What it has to ask between pieces: so long takes Ctrl-C.",
    "Unlike what is told as the residual it is smooth.",
    "What tells joint values by name is a mapping.",
    "This is as good as exact.",
    "It hands over the array.",
    "The kernel writes what is asked.",
    "Not asked are the others.",
)

ACCEPTED = (
    "A missed tolerance is reported as a status; no exception is raised.",
    "Ranges about exactly two axes are rejected.",
    "The search is skipped if the closed form is known to be complete.",
    "Call `should_continue()` about every 10 ms.",
    "A mapping from joint name to value, e.g. a ROS JointState. Unknown names are ignored.",
    "Show which kernels are in use: prebuilt library, Numba or Python.",
)


@pytest.mark.parametrize("sentence", STOPPED)
def test_a_sentence_that_made_readers_stop_is_found(sentence: str) -> None:
    assert list(PROSE["complaints_in"](sentence))


@pytest.mark.parametrize("sentence", ACCEPTED)
def test_a_plain_sentence_is_accepted(sentence: str) -> None:
    assert not list(PROSE["complaints_in"](sentence))


def test_code_is_skipped_and_lines_are_those_of_the_file(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Title\n\n```text\nIt lacks.\n```\n\nThis `lacks` is code.\nThis lacks one.\n")
    assert [line for line, _, _ in PROSE["complaints"](page)] == [8]
    module = tmp_path / "module.py"
    module.write_text('"""A module.\n\nThis lacks one.\n"""\n\nlacks = "it lacks"\n')
    assert [line for line, _, _ in PROSE["complaints"](module)] == [3]
