"""Pictures: lines go through the joints, and what cannot be drawn says so."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import kinseek
from chains import serial_chains
from kinseek import plots
from kinseek.robots.chain import SerialChain, joint_points
from reference import fk


@pytest.mark.slow
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


def test_a_picture_that_cannot_be_drawn_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from matplotlib.figure import Figure

    def fail(figure: Any, file: Any, **options: Any) -> None:
        file.write(b"a part")
        raise OSError(28, "No space left on device")

    (tmp_path / "arm.png").write_bytes(b"before")
    monkeypatch.setattr(Figure, "savefig", fail)
    with pytest.raises(kinseek.InvalidProblem, match="No space left on device; it was not written"):
        plots.save(Figure(), tmp_path / "arm.png")
    assert (tmp_path / "arm.png").read_bytes() == b"before"


def test_a_function_has_no_links_to_draw() -> None:
    arm = kinseek.Arm.from_fk(lambda q: np.tile(np.eye(4), (len(q), 1, 1)), [0.0], [1.0], name="box")
    _, axes = plots.space()
    with pytest.raises(kinseek.InvalidProblem, match="'box' has black-box kinematics"):
        plots.draw_arm(axes, arm, [0.5])


INLINE = """
import matplotlib
from matplotlib.backends.backend_agg import FigureCanvas
matplotlib.interactive(True)  # As that of notebooks does when the first figure loads it.
"""
CELLS = """
import kinseek, matplotlib
from kinseek import plots
arm = kinseek.load("planar2")
for figure in (plots.arm(arm, [0.1, 0.2]), plots.plane()[0], plots.arm(arm, [0.3, 0.4])):
    assert figure.axes
    print(matplotlib.pyplot.get_fignums(), matplotlib.is_interactive())
figure.savefig("arm.png")
matplotlib.pyplot.figure()
print(matplotlib.pyplot.get_fignums(), matplotlib.rcParams["font.size"])
"""


@pytest.mark.slow
def test_a_notebook_shows_a_figure_once(tmp_path: Path) -> None:
    """At the end of a cell it shows the figures that pyplot holds, and the one that the cell returns."""
    (tmp_path / "notebook_inline.py").write_text(INLINE)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        [sys.executable, "-c", CELLS],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": path, "MPLBACKEND": "module://notebook_inline"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines() == ["[] True"] * 3 + ["[1] 10.0"]
    assert (tmp_path / "arm.png").stat().st_size > 1000
