"""Keeps what a search does, pass by pass, if that was asked for."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from kinseek.problem import Problem, endless
from kinseek.solution import judge
from kinseek.trace import Pass, Trace

Array = NDArray[np.float64]


class Window(NamedTuple):
    """Where a pass looks."""

    spacing: Array
    """Of each joint, (n,), [rad] or [m]; NaN where it is left alone."""
    lower: Array
    """(n,), [rad] or [m]"""
    upper: Array
    """(n,), [rad] or [m]"""
    counts: NDArray[np.int64]
    """Number of values of each joint, (n,)."""


class Recorder:
    """Takes the passes of the search for one target, and makes a `Trace` of them.

    A search makes one only where ``problem.trace`` says so; without it nothing is kept and nothing is slower.
    """

    def __init__(self, problem: Problem, search: object) -> None:
        """Keep the passes of `search`, an object or its name, for one target."""
        self.problem = problem
        self.search = search if isinstance(search, str) else type(search).__name__
        self._kept: list[dict[str, object]] = []
        self._q: list[Array] = []
        self._starts: list[Array | None] = []
        self._notes: list[str] = []
        self._totals = (0, 0, 0)

    def add(
        self,
        name: str,
        q: Array,
        spent: int,
        created: int = 0,
        expanded: int = 0,
        *,
        memory: int = 0,
        window: Window | None = None,
        cells: int = 1,
        start: ArrayLike | None = None,
    ) -> None:
        """Keep a pass.

        Args:
            name: What it is.
            q: The best joint values known after it, (n,), as the search has them.
            spent: FK evaluations up to its end, this pass and all before it.
            created: Nodes made, likewise.
            expanded: Nodes visited, likewise.
            memory: Held while it ran [bytes].
            window: Where it looked.
            cells: Number of windows.
            start: Where it began, (n,), if that is not the best before it.
        """
        totals = int(spent), int(created), int(expanded)
        now = (new - old for new, old in zip(totals, self._totals, strict=True))
        fields: dict[str, object] = dict(
            zip(("evaluations", "nodes_created", "nodes_expanded"), now, strict=True)
        )
        self._totals = totals
        best = np.array(self.problem.placed(np.asarray(q, dtype=float)))
        if window is not None:
            # Where a continuous joint was turned to be near to where the user wants it, its window turns with it.
            turned = np.where(endless(self.problem.chain), best - q, 0.0)
            fields |= {
                "spacing": np.array(window.spacing, dtype=float),
                "lower": window.lower + turned,
                "upper": window.upper + turned,
                "counts": np.array(window.counts, dtype=np.int64),
            }
        self._kept.append({"name": name, "memory": int(memory), "cells": int(cells), **fields})
        self._q.append(best)
        self._starts.append(None if start is None else np.array(start, dtype=float))

    def note(self, sentence: str) -> None:
        """Keep a sentence, once."""
        if sentence not in self._notes:
            self._notes.append(sentence)

    def finish(self) -> Trace:
        """The trace; every pass is judged by plain forward kinematics."""
        passes = []
        if self._kept:
            errors = [self._judged(q) for q in self._q]
            first = [float("nan") if start is None else self._judged(start)[2] for start in self._starts]
            for fields, q, start, row, error in zip(
                self._kept, self._q, self._starts, errors, first, strict=True
            ):
                passes.append(
                    Pass(
                        q=q,
                        position_error=row[0],
                        orientation_error=row[1],
                        weighted_error=row[2],
                        start=start,
                        start_error=error,
                        **fields,  # type: ignore[arg-type]
                    )
                )
        chain = self.problem.chain
        return Trace(self.search, chain.joint_names, chain.kinds, tuple(passes), tuple(self._notes))

    def _judged(self, q: Array) -> tuple[float, float, float]:
        """Position error [m], orientation error [rad] and weighted error at joint values, (n,)."""
        position, orientation, weighted = judge(self.problem, q[None])[0].tolist()
        return position, orientation, weighted
