"""The parts that a search or a tracker adds to an exported program."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidExport
from kinseek.kernels.arrays import ChainArrays
from kinseek.kernels.entry import Entry
from kinseek.robots.chain import SerialChain
from kinseek.robots.mechanism import no_axes

from .c_text import array, guarded, structure

C = Path(__file__).parent / "c"
"""C files that are copied unchanged; files of a search are in a folder of their own."""

_HEAD, _ALIGNMENT = 64, 32  # Maxima as in c/runtime.c; short addresses need less.


@dataclass(frozen=True)
class Design:
    """The parts that a search or a tracker adds: its compiled kernels, its constants, and its memory."""

    folder: str
    """Folder of its C files below `C`."""
    entries: tuple[Entry, ...]
    routines: tuple[str, ...]
    numbers: dict[str, object]
    """Named constants in C."""
    chain: ChainArrays
    axis_weights: NDArray[np.float64]
    texts: dict[str, str]
    """Text files of constants."""
    data: dict[str, bytes]
    """Binary files of constants."""
    constants: int
    """Size of all these, without the chain and the weights [bytes]."""
    room: int
    """Size of working memory, see `room_for` [bytes]."""
    ram: int
    """Size of static memory, including working memory [bytes]."""
    lanes: int = 1
    """Number of leaves that are tabulated at once."""
    most_lanes: int = 1
    """Number of leaves that would be tabulated at once without a memory limit."""
    sizes: tuple[int, ...] = (1, 1, 1, 1)
    """Sizes for which the memory of a descent is made."""
    source: str = "search.c"
    """The C file of the folder that defines its functions."""
    memory: int | None = None
    """Number of values in that memory; None without a descent."""


def room_for(*numbers: int) -> int:
    """Return the bytes of working memory for simultaneous arrays of these lengths."""
    return sum(_HEAD + _ALIGNMENT + 8 * each for each in numbers)


def exported_axes(arm: object, where: str) -> SerialChain:
    """Return the axes and links of an arm that is exported to something.

    Raises:
        InvalidExport: It is no arm, or has none.
    """
    if not isinstance(arm, Arm):
        raise InvalidExport(f"an export needs an Arm, as kinseek.load gives it, got {type(arm).__name__}")
    if arm.axes is None:
        why = f"{where} is given the axes and links of an arm"
        raise InvalidExport(
            f"an arm with black-box kinematics cannot be exported: {no_axes(arm.mechanism, why)}"
        )
    return arm.axes


def chain_constants(chain: ChainArrays, axis_weights: NDArray[np.float64]) -> tuple[str, int]:
    """Return the constants of forward kinematics and the error measure in C, and their size in bytes."""
    arrays = {f"chain_{name}": each for name, each in chain._asdict().items()} | {
        "axis_weights": axis_weights
    }
    lines = ['#include "calls.h"', *(array(name, each) for name, each in arrays.items())]
    lines.append(structure("KinseekChainArrays", "chain", {name: f"chain_{name}" for name in chain._fields}))
    # Not every file that includes them uses all.
    unused = [line.replace("static const ", "__attribute__((unused)) static const ", 1) for line in lines]
    return guarded("KINSEEK_CONSTANTS_H", unused), sum(each.nbytes for each in arrays.values())
