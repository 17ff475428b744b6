"""Export of arms for use without Python: C and machine code for small controllers, WebAssembly for web pages.

See docs/embedded.md and docs/page.md.

>>> import kinseek
>>> from kinseek.export import to_c
>>> parts = to_c(kinseek.load("scara4"), "scara4_c", target="thumbv7em", ram=64 * 1024)  # doctest: +SKIP
"""

from .controller import Parts, checked_folder, prepare, to_c
from .javascript import to_wasm
from .targets import TARGETS, Target
from .wasm import wasm_module

__all__ = ["TARGETS", "Parts", "Target", "checked_folder", "prepare", "to_c", "to_wasm", "wasm_module"]
