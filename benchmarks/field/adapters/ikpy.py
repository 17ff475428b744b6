"""ikpy, as its README has it: `inverse_kinematics_frame(T)` with all axes of the turn; it says nothing of success.

https://github.com/Phylliade/ikpy. Without a start at the middle of the ranges. Its symbolic chain takes seconds to
make. In the sweep numeric chains, and several starts, of which the best answer by ikpy's own forward kinematics is
kept.
"""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, without_followers

NAME = "ikpy"
PACKAGE = "ikpy"
RECOMMENDED: dict[str, Any] = {"symbolic": True, "tolerance": None, "starts": 1}
SWEEP: tuple[dict[str, Any], ...] = (
    {"symbolic": False, "tolerance": None, "starts": 1},
    {"symbolic": False, "tolerance": 1e-12, "starts": 3},
    {"symbolic": False, "tolerance": 1e-12, "starts": 10},
)


class _Solver:
    def __init__(self, arm: Arm, settings: dict[str, Any]) -> None:
        from ikpy.chain import Chain

        without_followers(arm)
        warnings.simplefilter("ignore")
        links = Chain.from_urdf_file(arm.urdf, base_elements=[arm.base], symbolic=False).links
        active = [link.name in arm.joints for link in links]
        self._chain = Chain.from_urdf_file(
            arm.urdf, base_elements=[arm.base], active_links_mask=active, symbolic=settings["symbolic"]
        )
        self._active, self._arm, self._set = np.array(active), arm, settings
        self._more = {} if settings["tolerance"] is None else {"tol": settings["tolerance"]}
        self._rng = np.random.default_rng(0)

    def solve(self, T: Any, start: Any) -> Answer:
        return self._asked(T, start, orientation_mode="all")

    def position(self, place: Array, start: Array | None) -> Answer:
        T = np.eye(4)
        T[:3, 3] = place
        return self._asked(T, start, orientation_mode=None)

    def _asked(self, T: Any, start: Any, orientation_mode: str | None) -> Answer:
        q, best, least = self._arm.middle if start is None else start, None, np.inf
        turns = orientation_mode is not None
        for _ in range(self._set["starts"]):
            begin = np.zeros(len(self._active))
            begin[self._active] = q
            found = self._chain.inverse_kinematics_frame(
                T, initial_position=begin, orientation_mode=orientation_mode, **self._more
            )
            if self._set["starts"] == 1:
                return Answer(found[self._active], None)
            apart = self._chain.forward_kinematics(found) - T
            error = np.abs(apart[:3, 3]).max() + turns * np.abs(apart[:3, :3]).max()
            if error < least:
                best, least = found[self._active], error
            if error < 1e-7:
                break
            q = self._rng.uniform(self._arm.lower, self._arm.upper)
        return Answer(best, None)


load = _Solver
