"""Processors for which machine code can be written."""

from __future__ import annotations

from dataclasses import dataclass

from kinseek.errors import InvalidExport, suggest


@dataclass(frozen=True)
class Cpu:
    """One processor, or a family whose members all run the same programs."""

    name: str
    """Name in LLVM."""
    features: str = ""
    """Additional features, in LLVM's notation."""
    options: str = ""
    """Options that a C compiler needs to make matching code."""


@dataclass(frozen=True)
class Target:
    """A kind of processor."""

    name: str
    triple: str
    """Target triple in LLVM."""
    compiler: str
    """Name of the C compiler for it in Debian, or on PyPI."""
    cpus: tuple[Cpu, ...]
    """The supported processors; the first is the default."""
    bits: int
    """Bits of an address."""
    relocation: str = "static"
    abi: str = ""
    numba: bool = False
    """Can Numba itself optimise for it? Then results have the same bits as kinseek on such a processor."""

    def cpu(self, name: str | None) -> Cpu:
        """Return the processor of a name; by default the first.

        Raises:
            InvalidExport: None has that name.
        """
        known = {one.name: one for one in self.cpus}
        if name is None:
            return self.cpus[0]
        if name not in known:
            raise InvalidExport(suggest(name, known, f"processor of {self.name}"))
        return known[name]


# Hard-float calls would be right for a Cortex-M with a floating-point unit, but Python bindings cannot set them in LLVM, and
# the code that it then makes for `aapcs16` links but computes wrong numbers. So numbers are passed in the integer registers
# (softfp).
_THUMB = "-mthumb -mfloat-abi=softfp"

_KNOWN = (
    Target(
        "x86-64",
        "x86_64-unknown-linux-gnu",
        "gcc",
        (Cpu("x86-64-v3", options="-march=x86-64-v3"), Cpu("x86-64-v2", options="-march=x86-64-v2")),
        64,
        "pic",
        numba=True,
    ),
    Target("aarch64", "aarch64-unknown-linux-gnu", "aarch64-linux-gnu-gcc", (Cpu("generic"),), 64, "pic"),
    Target(
        "thumbv7em",
        "thumbv7em-none-eabi",
        "arm-none-eabi-gcc",
        (
            Cpu("cortex-m7", options=f"-mcpu=cortex-m7 -mfpu=fpv5-d16 {_THUMB}"),
            Cpu("cortex-m4", options=f"-mcpu=cortex-m4 -mfpu=fpv4-sp-d16 {_THUMB}"),
        ),
        32,
    ),
    Target(
        "riscv32",
        "riscv32-unknown-elf",
        "riscv64-unknown-elf-gcc",
        (
            Cpu("generic-rv32", "+m,+c", "-march=rv32imc -mabi=ilp32"),
            Cpu("sifive-e31", "", "-march=rv32imac -mabi=ilp32"),
        ),
        32,
        abi="ilp32",
    ),
    Target(
        "wasm32",
        "wasm32-unknown-unknown",
        "python -m ziglang cc -target wasm32-wasi",
        (Cpu("generic", "+simd128,+bulk-memory,+sign-ext,+nontrapping-fptoint", "-msimd128"),),
        32,
    ),
)

TARGETS: dict[str, Target] = {one.name: one for one in _KNOWN}
"""All targets by name."""


def target_of(name: str) -> Target:
    """Return the target of a name.

    Raises:
        InvalidExport: None has that name.
    """
    if name not in TARGETS:
        raise InvalidExport(suggest(str(name), TARGETS, "target"))
    return TARGETS[name]
