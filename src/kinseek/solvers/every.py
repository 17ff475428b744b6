"""All searches."""

from __future__ import annotations

from .atlas.solver import Atlas
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
