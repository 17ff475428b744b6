"""KDL, through PyKDL: Levenberg-Marquardt from a start, as the Orocos project's manual has it.

https://www.orocos.org/wiki/orocos/kdl-wiki. Its archive on PyPI has to be compiled against KDL of the system, so the
requirements ask for a wheel alone: until somebody publishes one, the page says that there is none. Within TRAC-IK it
is measured.
"""

from __future__ import annotations

from typing import Any

from benchmarks.field.protocol import Arm, Refused, Solver

NAME = "KDL"
PACKAGE = "PyKDL"
RECOMMENDED: dict[str, Any] = {}
SWEEP: tuple[dict[str, Any], ...] = ()


def load(arm: Arm, settings: dict[str, Any]) -> Solver:
    """There has been no wheel to write this against."""
    raise Refused("no wheel on PyPI when this was written")
