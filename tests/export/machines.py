"""Machines that exported programs are tested on: this one, and an emulated Cortex-M7."""

from __future__ import annotations

from pathlib import Path

from kinseek.export import TARGETS
from places import ROOT

EXAMPLE = ROOT / "examples" / "cortex_m7"
M7 = [
    *TARGETS["thumbv7em"].cpus[0].options.split(),
    "--specs=rdimon.specs",
    "-nostartfiles",
    "-Wl,--no-warnings",
]
M7 += [str(EXAMPLE / "start.c"), "-T", str(EXAMPLE / "part.ld")]
BOARD = ["-M", "mps2-an500", "-nographic", "-semihosting-config", "enable=on,target=native", "-kernel"]


def levels() -> set[str]:
    """Return the flags of this processor; none where they are unknown."""
    try:
        text = Path("/proc/cpuinfo").read_text()
    except OSError:
        return set()
    return set(next((line for line in text.splitlines() if line.startswith("flags")), "").split())
