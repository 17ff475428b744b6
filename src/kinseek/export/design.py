"""What a search brings along to a part."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from kinseek.kernels.arrays import ChainArrays
from kinseek.kernels.entry import Entry

from .c_text import array, guarded, structure

C = Path(__file__).parent / "c"
"""Files in C that are written as they are; what a search adds stands in a folder of its own."""

_HEAD, _ALIGNMENT = 64, 32  # As c/runtime.c has them at most: less where addresses are short.


@dataclass(frozen=True)
class Design:
    """What a search brings along: what is compiled for it, its constants, and the memory it takes."""

    folder: str
    """Below `C`."""
    entries: tuple[Entry, ...]
    routines: tuple[str, ...]
    numbers: dict[str, object]
    """Constants that C has by name."""
    chain: ChainArrays
    axis_weights: NDArray[np.float64]
    texts: dict[str, str]
    """Files of constants."""
    data: dict[str, bytes]
    """Files of constants that are no text."""
    constants: int
    """[bytes] of all these, but for the chain and the weights."""
    room: int
    """[bytes] of working memory, see `room_for`."""
    ram: int
    """[bytes] of static memory, working memory included."""
    lanes: int = 1
    """Leaves that are tabulated at once."""
    most_lanes: int = 1
    """Leaves that would be tabulated at once without a limit on memory."""
    sizes: tuple[int, ...] = (1, 1, 1, 1)
    """What the memory of a descent is made for."""
    memory: int | None = None
    """Numbers that it then holds; None where there is no descent."""


def room_for(*numbers: int) -> int:
    """Bytes of working memory for arrays of so many numbers at once."""
    return sum(_HEAD + _ALIGNMENT + 8 * each for each in numbers)


def chain_constants(chain: ChainArrays, axis_weights: NDArray[np.float64]) -> tuple[str, int]:
    """What forward kinematics and the measure of errors need, as C, and its bytes."""
    arrays = {f"chain_{name}": each for name, each in chain._asdict().items()} | {
        "axis_weights": axis_weights
    }
    lines = ['#include "calls.h"', *(array(name, each) for name, each in arrays.items())]
    lines.append(structure("KinseekChainArrays", "chain", {name: f"chain_{name}" for name in chain._fields}))
    # Not every file that includes them makes use of all.
    unused = [line.replace("static const ", "__attribute__((unused)) static const ", 1) for line in lines]
    return guarded("KINSEEK_CONSTANTS_H", unused), sum(each.nbytes for each in arrays.values())
