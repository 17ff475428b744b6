"""The searches.

What each finds, needs and costs is said by its `Traits`; `traits.table` puts them together.

Every search is a frozen dataclass of its parameters with one method, ``solve(problem) -> Solution``. A new
one is a file here and a line in `ALL_SOLVERS`; from then on the tests and the command line have it.
"""

from __future__ import annotations

from .atlas.solver import Atlas
from .base import Solver
from .blind_search import BlindSearch
from .brute_force import BruteForce
from .coordinate_descent import CoordinateDescent
from .divide_and_conquer import DivideAndConquer
from .polished import Polished
from .separate_chains import SeparateChains
from .traits import OwnSolver

ALL_SOLVERS: tuple[type[OwnSolver], ...] = (
    Atlas,
    BruteForce,
    DivideAndConquer,
    SeparateChains,
    BlindSearch,
    CoordinateDescent,
    Polished,
)

__all__ = [
    "ALL_SOLVERS",
    "Atlas",
    "BlindSearch",
    "BruteForce",
    "CoordinateDescent",
    "DivideAndConquer",
    "Polished",
    "SeparateChains",
    "Solver",
]
