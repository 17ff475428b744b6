"""Machines for which a library can be built on another one, with their names in LLVM, the linker and wheels."""

from __future__ import annotations

from dataclasses import dataclass, field

LEVELS = {
    "x86_64": {2: "x86-64-v2", 3: "x86-64-v3", 4: "x86-64-v4"},
    "aarch64": {1: "generic"},
}
"""LLVM's names of the levels of each kind of processor."""

COMPILING = {
    "KINSEEK_JIT": "1",
    "NUMBA_CPU_FEATURES": "",
    "NUMBA_DISABLE_JIT": "0",
    "PYTHONDONTWRITEBYTECODE": "1",
    "PYTHONHASHSEED": "0",  # Otherwise the order of Numba's sets, and with it the code, would differ each time.
}
"""Environment of a process that compiles for this machine."""

COMPILING_FOR_OTHERS = {"NUMBA_OPT": "0", "NUMBA_CPU_NAME": "generic", "PYTHONWARNINGS": "ignore"}
"""Additions and changes to it for other machines."""


@dataclass(frozen=True)
class Target:
    """A kind of processor and a system."""

    processor: str
    triple: str
    """Target triple in LLVM."""
    linker: str
    """Target of ``zig cc``; empty if it cannot link for this one."""
    suffix: str
    """Suffix of the library's file name."""
    tag: str
    """Platform tag of a wheel: the oldest system that runs the library. On Linux it depends on the library's symbols."""
    cpu: str = ""
    """LLVM's name of the oldest processor of the system, if that is newer than the level requires."""
    options: tuple[str, ...] = field(default=())
    """Options for the linker."""

    @property
    def levels(self) -> dict[int, str]:
        """LLVM's names of the levels of its processor."""
        known = LEVELS[self.processor]
        return dict.fromkeys(known, self.cpu) if self.cpu else known

    @property
    def windows(self) -> bool:
        """Whether it is for Windows."""
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
"""All targets by their names for ``native/build.py --target``."""
