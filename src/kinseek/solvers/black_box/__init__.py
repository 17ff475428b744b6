"""The searches on a mechanism of which only a function is known (`Arm.from_fk`), in NumPy.

Each search of `kinseek.solvers` that needs nothing but poses hands over to its twin here:

| search | here | costs |
| --- | --- | --- |
| `Atlas` | `samples.py` and `refine.py` | samples once; then 1 + n poses a step and seed |
| `DivideAndConquer`, `BruteForce` | `grid.py` | the leaves of the grid |
| `CoordinateDescent` | `coordinates.py` | 3 poses a joint, 9 a pair, where its premise holds |

The function is only ever asked inside the limits, with many rows at once, and every pose that it gives is checked and
counted. Every target of a batch is solved by itself: what a function answers may depend, in its last bits, on how many
rows it is asked for.
"""
