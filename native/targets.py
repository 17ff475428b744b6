"""Machines that a library can be built for from another one: what LLVM, the linker and wheels call each of them."""

from __future__ import annotations

from dataclasses import dataclass, field

LEVELS = {
    "x86_64": {2: "x86-64-v2", 3: "x86-64-v3", 4: "x86-64-v4"},
    "aarch64": {1: "generic"},
}
"""Names that LLVM has for the levels of each kind of processor."""

COMPILING = {
    "KINSEEK_JIT": "1",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_DISABLE_JIT": "0",
    "PYTHONDONTWRITEBYTECODE": "1",
    "PYTHONHASHSEED": "0",  # Else sets of Numba have another order each time, and so has the code.
}
"""Environment of a process that compiles, for this machine."""

COMPILING_FOR_OTHERS = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "PYTHONWARNINGS": "ignore"}
"""What is added to it, or replaced, for other machines."""


@dataclass(frozen=True)
class Target:
    """A kind of processor and a system."""

    processor: str
    triple: str
    """As LLVM takes it."""
    linker: str
    """As ``zig cc -target`` takes it; empty where it cannot link for it."""
    suffix: str
    """Of the library's file name."""
    tag: str
    """Of a wheel: the oldest system that runs what is linked so. On Linux it follows from the library."""
    cpu: str = ""
    """As LLVM calls the oldest processor of the system, where that is more than the level asks for."""
    options: tuple[str, ...] = field(default=())
    """For the linker."""

    @property
    def levels(self) -> dict[int, str]:
        """Names that LLVM has for the levels of its processor."""
        known = LEVELS[self.processor]
        return dict.fromkeys(known, self.cpu) if self.cpu else known

    @property
    def windows(self) -> bool:
        """Is it for Windows?"""
        return "windows" in self.triple


_ELF = ("-Wl,-Bsymbolic", "-Wl,--gc-sections")

TARGETS = {
    "x86_64-linux-gnu": Target(
        "x86_64", "x86_64-unknown-linux-gnu", "x86_64-linux-gnu.2.17", ".abi3.so", "", "", _ELF
    ),
    "aarch64-linux-gnu": Target(
        "aarch64", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu.2.17", ".abi3.so", "", "", _ELF
    ),
    "arm64-apple-darwin": Target(
        "aarch64",
        "arm64-apple-macosx11.0.0",
        "aarch64-macos.11.0",
        ".abi3.so",
        "macosx_11_0_arm64",
        "apple-m1",
        ("-Wl,-undefined,dynamic_lookup",),
    ),
    "x86_64-pc-windows-gnu": Target(
        "x86_64", "x86_64-pc-windows-gnu", "x86_64-windows-gnu", ".pyd", "win_amd64", "", ()
    ),
    "x86_64-pc-windows-msvc": Target("x86_64", "x86_64-pc-windows-msvc", "", ".pyd", "win_amd64", "", ()),
}
"""By the names that ``native/build.py --target`` takes."""
