"""The searches.

| search | from | finds | needs a start | cost |
| --- | --- | --- | --- | --- |
| `Atlas` | kinseek, the default | an answer where there is one | no | some 40 FK |
| `BruteForce` | paper, Sec. 3.1 | the best node of the grid | no | Σ B^i nodes |
| `DivideAndConquer` | paper, Sec. 3.1 and 3.2 | a good node of a fine grid | no | log B passes |
| `BlindSearch` | Cubero 2008 | a local minimum | yes | 3^n a step |
| `CoordinateDescent` | kinseek | a local minimum, joint by joint | yes | 3 FK a joint, 9 a pair |
| `Polished` | kinseek | what its two searches find, one after the other | no | both |

Every search is a frozen dataclass of its parameters with one method, ``solve(problem) -> Solution``. A new
one is a file here and a line in `ALL_SOLVERS`; from then on the tests cover it.
"""

from __future__ import annotations

from .atlas.solver import Atlas
from .base import Solver
from .blind_search import BlindSearch
from .brute_force import BruteForce
from .coordinate_descent import CoordinateDescent
from .divide_and_conquer import DivideAndConquer
from .polished import Polished

ALL_SOLVERS: tuple[type[Solver], ...] = (
    Atlas,
    BruteForce,
    DivideAndConquer,
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
    "Solver",
]
