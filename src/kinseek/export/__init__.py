"""Arms for small controllers, C and machine code for a processor that runs no Python (docs/embedded.md); and for web pages,
WebAssembly (docs/page.md).

>>> import kinseek
>>> from kinseek.export import to_c
>>> told = to_c(kinseek.load("scara4"), "scara4_c", target="thumbv7em", ram=64 * 1024)  # doctest: +SKIP
"""

from .controller import Parts, checked_folder, prepare, to_c
from .targets import TARGETS, Target
from .wasm import to_wasm, wasm_module

__all__ = ["TARGETS", "Parts", "Target", "checked_folder", "prepare", "to_c", "to_wasm", "wasm_module"]
