"""Arms for small controllers: C, and machine code for a processor that runs no Python; see docs/embedded.md.

>>> import kinseek
>>> from kinseek.export import to_c
>>> told = to_c(kinseek.load("scara4"), "scara4_c", target="thumbv7em", ram=64 * 1024)  # doctest: +SKIP
"""

from .targets import TARGETS, Target
from .controller import Parts, prepare, to_c

__all__ = ["TARGETS", "Parts", "Target", "prepare", "to_c"]
