"""Pictures: lines go through the joints, and what cannot be drawn says so."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from chains import serial_chains
from kinseek import plots
from kinseek.robots.chain import SerialChain, joint_points
from reference import fk


@given(chain=serial_chains(), share=st.floats(0, 1))
@settings(max_examples=30)
def test_the_line_of_an_arm_ends_at_its_tip(chain: SerialChain, share: float) -> None:
    q = chain.lower + share * (chain.upper - chain.lower)
    points = joint_points(chain, q)
    assert len(points) == len(chain.leader) + chain.prismatic.sum() + 2
    np.testing.assert_array_equal(points[0], 0.0)
    np.testing.assert_allclose(points[-1], fk(chain, q)[:3, 3], atol=1e-9)


@pytest.mark.slow
def test_a_picture_is_written(tmp_path: Path) -> None:
    arm = kinseek.load("scara4")
    figure, axes = plots.space()
    plots.draw_arm(axes, arm, np.zeros(4))
    plots.draw_frame(axes, arm.fk(np.zeros(4)), 0.1)
    plots.same_scale(axes)
    path = plots.save(figure, tmp_path / "arm.png")
    assert path.read_bytes()[:4] == b"\x89PNG"


def test_a_function_has_no_links_to_draw() -> None:
    arm = kinseek.Arm.from_fk(lambda q: np.tile(np.eye(4), (len(q), 1, 1)), [0.0], [1.0], name="box")
    _, axes = plots.space()
    with pytest.raises(kinseek.InvalidProblem, match="'box' is a function"):
        plots.draw_arm(axes, arm, [0.5])


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(kinseek.MissingExtra, match=r"kinseek\[plot\]"):
        plots.plane()
