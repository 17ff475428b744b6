"""The searches.

The `Traits` of each search say what it finds, needs and costs; `traits.table` combines them.

Every search is a frozen dataclass of its parameters with one method, ``solve(problem) -> Solution``. To add a search, add a
file here and an entry in `every.ALL_SOLVERS`; the tests and the command line then include it.
"""

from __future__ import annotations

import typing

from kinseek.lazy_imports import lazy_names as _lazy_names

from .atlas.solver import Atlas
from .base import Solver

if typing.TYPE_CHECKING:
    from .blind_search import BlindSearch
    from .brute_force import BruteForce
    from .coordinate_descent import CoordinateDescent
    from .divide_and_conquer import DivideAndConquer
    from .every import ALL_SOLVERS
    from .polished import Polished
    from .separate_chains import SeparateChains

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

__getattr__, __dir__ = _lazy_names(
    globals(),
    {
        "ALL_SOLVERS": ".every",
        "BlindSearch": ".blind_search",
        "BruteForce": ".brute_force",
        "CoordinateDescent": ".coordinate_descent",
        "DivideAndConquer": ".divide_and_conquer",
        "Polished": ".polished",
        "SeparateChains": ".separate_chains",
    },
)
