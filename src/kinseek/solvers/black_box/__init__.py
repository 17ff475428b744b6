"""Searches for black-box kinematics (`Arm.from_fk`), in NumPy.

Each search of `kinseek.solvers` that only needs poses calls its counterpart here:

| search | here | costs |
| --- | --- | --- |
| `Atlas` | `samples.py` and `refine.py` | samples once; then 1 + n poses a step and seed |
| `DivideAndConquer`, `BruteForce` | `solvers/grid_search.py` calls the function itself | the leaves of the grid |
| `CoordinateDescent` | `coordinates.py` | 3 poses a joint, 9 a pair, where its premise holds |

The function is only called inside the limits, with many rows at once, and every pose that it returns is checked and counted.
Every target of a batch is solved separately: the last bits of a function's result may depend on the number of rows in the
call.
"""
