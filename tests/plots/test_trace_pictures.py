"""Pictures of searches: they show what the trace says, can be read, and refuse what they cannot draw."""

from __future__ import annotations

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

import kinseek
from kinseek import plots
from kinseek.errors import InvalidUse
from kinseek.solution import Solution
from legible import faults_of_saved
from places import ROOT

pytestmark = pytest.mark.slow

pytest.importorskip("matplotlib")

EXAMPLE = ROOT / "examples" / "09_trace.py"

PLANAR, CYLINDRICAL = kinseek.load("planar2"), kinseek.load("cylindrical3")


def planar(**options: int) -> Solution:
    search = kinseek.DivideAndConquer(**options)  # type: ignore[arg-type]
    return PLANAR.ik(PLANAR.fk([2.0, 1.1]), solver=search, trace=True)


@pytest.fixture
def found(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    return faults_of_saved(monkeypatch)


@pytest.mark.parametrize("which", ["tree", "circles", "breadths", "windows", "progress"])
def test_pictures_of_the_example_can_be_read(
    which: str, found: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "argv", [str(EXAMPLE), str(tmp_path / "picture.png"), which])
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    assert found == []


def test_other_searches_can_be_read(found: list[str], tmp_path: Path) -> None:
    target = CYLINDRICAL.fk((CYLINDRICAL.lower + CYLINDRICAL.upper) / 2 + 0.1)
    wide = CYLINDRICAL.ik(target, solver=kinseek.DivideAndConquer(breadth=2), trace=True)
    for figure in (
        plots.tree(wide, 2),
        plots.windows(wide, (0, 2)),
        plots.circles(wide, "turn", passes=2),
        plots.windows(planar(divisions=8)),
        plots.progress([wide, wide, planar()], error="position"),
    ):
        plots.save(figure, tmp_path / "picture.png")
    assert found == []


def test_progress_ends_at_the_evaluations_and_the_error_of_the_answer() -> None:
    solution = planar(breadth=2)
    (axes,) = plots.progress({"one": solution}).axes
    spent, errors = axes.lines[0].get_data()
    assert (spent[-1], errors[-1]) == (solution.evaluations, solution.weighted_error)
    assert len(spent) == len(solution.trace)


def test_a_tree_has_a_leaf_for_each_node_and_marks_the_best() -> None:
    solution = planar(breadth=2)
    axes = plots.tree(solution).axes[0]
    leaves = axes.collections[-2]
    assert len(leaves.get_offsets()) == 9
    marked = axes.collections[-1].get_offsets()[0, 0]
    assert marked == np.argmin(leaves.get_array())
    assert leaves.get_array().min() == pytest.approx(np.log10(solution.trace[0].weighted_error))


def test_windows_are_frames_where_the_trace_has_them() -> None:
    solution = planar(breadth=2)
    axes = plots.windows(solution).axes
    corners = {patch.get_xy() for patch in axes[0].patches}
    second = solution.trace[1]
    assert tuple(second.lower) in corners
    # Of a joint that wraps a window beyond the end is seen at the other end too.
    assert (second.lower[0], second.lower[1] + 2 * np.pi) in corners


def test_circles_have_a_spoke_for_each_value() -> None:
    solution = planar(breadth=2)
    axes = plots.circles(solution, passes=3).axes
    # The circle, the spokes, and the best.
    assert [len(each.lines) - 2 for each in axes] == [3, 5, 5]
    axes = plots.breadths([planar(breadth=b) for b in (1, 2, 3)]).axes
    assert [len(each.lines) - 2 for each in axes] == [3, 5, 7]


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        (lambda: plots.progress({}), "at least one trace"),
        (lambda: plots.progress([planar()], error="speed"), "weighted, position, orientation"),
        (lambda: plots.progress([3]), "got int"),  # type: ignore[list-item]
        (lambda: plots.tree(PLANAR.ik(PLANAR.fk([2.0, 1.1]))), "trace=True"),
        (lambda: plots.tree(PLANAR.ik(PLANAR.fk([[2.0, 1.1]]), trace=True)), "choose one"),
        (lambda: plots.tree(PLANAR.ik(PLANAR.fk([2.0, 1.1]), trace=True)), "has no window"),
        (lambda: plots.tree(planar(), 99), "from 1 to"),
        (lambda: plots.tree(planar(divisions=40)), "1,600 leaves"),
        (lambda: plots.circles(planar(), "elbow"), "valid: joint1, joint2"),
        (lambda: plots.circles(planar(), 2), "from 0 to 1"),
        (
            lambda: plots.circles(planar(), 1.7),  # type: ignore[arg-type]
            "unless it is a name, must be a whole number from 0 to 1, got 1.7",
        ),
        (lambda: plots.circles(planar(), passes=0), "passes must be a whole number of at least 1, got 0"),
        (lambda: plots.tree(planar(), "pass 1"), "from 1 to 8"),  # type: ignore[arg-type]
        (lambda: plots.tree(planar().trace), "give the solution"),
        (lambda: plots.windows(planar().trace), "give the solution"),
        (lambda: plots.windows(planar(), (0, 0)), "two different"),
        (lambda: plots.windows(planar(), (0, "elbow")), "valid: joint1, joint2"),
        (lambda: plots.windows(planar(), 0), "joints must be two"),  # type: ignore[arg-type]
        (lambda: plots.save(plots.plane()[0], "arm.svg"), "must end in .png, got 'arm.svg'"),
        (lambda: plots.save(plots.plane()[0], "arm"), "must end in .png, got 'arm'"),
        (lambda: plots.windows(PLANAR.ik(PLANAR.fk([2.0, 1.1]), trace=True)), "no pass"),
    ],
)
def test_what_cannot_be_drawn_says_so(draw: object, words: str) -> None:
    with pytest.raises(InvalidUse, match=words):
        draw()  # type: ignore[operator]


def test_joints_have_names_in_every_picture() -> None:
    by_name = plots.windows(planar(), ("joint2", "joint1")).axes
    assert [each.get_xlabel() for each in by_name[:2]] == ["joint2 [rad]"] * 2


def test_passes_that_leave_a_joint_alone_are_no_circles() -> None:
    solution = PLANAR.ik(PLANAR.fk([2.0, 1.1]), solver=kinseek.SeparateChains(again=float("inf")), trace=True)
    titles = [each.get_title() for each in plots.circles(solution, "joint2").axes]
    assert all("goal: pass" in each and "nan" not in each for each in titles)


def test_a_slide_is_no_circle() -> None:
    target = CYLINDRICAL.fk((CYLINDRICAL.lower + CYLINDRICAL.upper) / 2)
    solution = CYLINDRICAL.ik(target, solver=kinseek.DivideAndConquer(), trace=True)
    with pytest.raises(InvalidUse, match="does not turn"):
        plots.circles(solution, "lift")
