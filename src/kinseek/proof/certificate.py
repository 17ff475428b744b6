"""The result of a proof."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from kinseek.problem import Problem


class Verdict(Enum):
    """What is proved; the value is the sentence to show."""

    REACHABLE = "Reachable: the witness meets both tolerances."
    UNREACHABLE = "Unreachable: no joint values within the limits meet both tolerances."
    UNDECIDED = "Undecided: neither a solution nor a proof that there is none."

    def __str__(self) -> str:
        """Return the sentence."""
        return self.value


@dataclass(frozen=True, eq=False)
class Certificate:
    """A theorem about one goal, with bounds of the arm's least error.

    The bounded error is the paper's weighted error ``E = K_P |p - p_g| + K_A [(1 - x·x_g) + (1 - y·y_g)]``. For a pointing
    goal the bracket contains only the tool axis; for a position goal it is absent. Every q inside the limits has ``E(q) >=
    lower_bound >= 0``, and `q` has ``E = upper_bound``. This also holds for the verdict UNDECIDED, and for any budget.
    """

    verdict: Verdict
    q: NDArray[np.float64]
    """The witness, or the best joint values found, (n,), [rad] or [m]; always inside the limits."""
    lower_bound: float
    """No q inside the limits has a smaller weighted error."""
    upper_bound: float
    """Weighted error of `q`."""
    position_error: float
    """Position error of `q` [m]."""
    orientation_error: float
    """Orientation error of `q` [rad]."""
    boxes: int
    """Boxes examined, the deterministic measure of work."""
    largest_box: float
    """Half width of the widest variable in any remaining box, [rad] or [m]; 0 if no box is left."""
    problem: Problem
    """The problem of the proof."""
    out_of_time: bool = False
    """Whether a time limit ended the search before its budget did. The bounds and `q` are those known by then."""

    @property
    def gap(self) -> float:
        """``(upper_bound - lower_bound) / upper_bound``; 0 if both are 0."""
        return 1.0 - self.lower_bound / self.upper_bound if self.upper_bound > 0.0 else 0.0

    def __str__(self) -> str:
        """Return one sentence with the figures."""
        return (
            f"{self.verdict} Weighted error of the best pose found {self.upper_bound:.4g}, of any pose at least "
            f"{self.lower_bound:.4g}; {self.boxes:,} {'box' if self.boxes == 1 else 'boxes'} examined"
            + (f", half width of the widest one left {self.largest_box:.3g}." if self.largest_box else ".")
            + (" The time was up." if self.out_of_time else "")
        )

    def _repr_html_(self) -> str:
        """Return HTML for notebooks: what is proved, the bounds, and a picture of the best pose found."""
        from kinseek.notebook.cards import certificate_card

        return certificate_card(self)

    def __repr__(self) -> str:
        """Return a short representation for a shell."""
        return (
            f"Certificate({self.verdict.name}, lower_bound={self.lower_bound:.6g}, "
            f"upper_bound={self.upper_bound:.6g}, boxes={self.boxes})"
        )
