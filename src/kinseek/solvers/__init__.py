"""The searches.

The `Traits` of each search say what it finds, needs and costs; `traits.table` combines them.

Every search is a frozen dataclass of its parameters with one method, ``solve(problem) -> Solution``. To add a search, add a
file here and a line to `MODULES`; the tests and the command line then include it.
"""

from kinseek.support.lazy_imports import lazy_names as _lazy_names

MODULES = {
    "Atlas": ".atlas.solver",
    "BruteForce": ".brute_force",
    "DivideAndConquer": ".divide_and_conquer",
    "SeparateChains": ".separate_chains",
    "BlindSearch": ".blind_search",
    "CoordinateDescent": ".coordinate_descent",
    "Polished": ".polished",
}
"""The searches and their modules, which are imported when they are first needed. The first one is the default."""

__all__ = ["ALL_SOLVERS", *MODULES]  # noqa: PLE0604  # A literal would list them a second time.

__getattr__, __dir__ = _lazy_names(globals(), {"ALL_SOLVERS": ".every", **MODULES})
