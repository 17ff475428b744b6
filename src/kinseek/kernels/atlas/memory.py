"""Scratch memory of a call, allocated in one block."""

from __future__ import annotations

from typing import NamedTuple

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import array_view
from kinseek.kernels.layout import DOF, Layout, floats, whole

from .lanes import LANES, Lanes
from .lanes import LAYOUT as LANES_LAYOUT
from .tree import LEAF_SIZE

DEEP = 160
"""Largest number of samples looked up for one goal."""


CANDIDATE_ROWS = 18
"""Rows of the candidates of a closed form, see `structure.candidates.WORK`."""


class Scratch(NamedTuple):
    """Scratch memory of one call."""

    lanes: Lanes
    seen: Array
    """The goal as the atlas sees it, (3, 4)."""
    spare: Array
    """(3, 4)"""
    between: Array
    """(3, 4)"""
    point: Array
    """Coordinates of the goal among the samples, (9,)."""
    distance: Array
    """(DEEP,)"""
    neighbour: Indices
    """(DEEP,)"""
    stack: Indices
    """(64,)"""
    bound: Array
    """(64 + LEAF_SIZE,)"""
    candidates: Array
    """Candidates of a closed form, one in each lane, (CANDIDATE_ROWS, LANES)."""
    seed: Array
    """(n,)"""
    found: Array
    """Joint values at which each lane converged, (LANES, n)."""
    state: Indices
    """State of each lane: 0 active, 1 converged, 2 empty, 3 given up, (LANES,)."""
    best: Array
    """Best joint values found, (LANES, n)."""
    best_error: Array
    """Their weighted errors, (LANES,)."""
    floor: Array
    """Smallest damping of each lane, (LANES,)."""
    columns: Array
    """Weights of the columns in the step, (3,)."""
    damping: Array
    """Factor from the squared error to the damping of the step, (1,)."""


LAYOUT = Layout(
    Scratch,
    lanes=LANES_LAYOUT,
    seen=floats(3, 4),
    spare=floats(3, 4),
    between=floats(3, 4),
    point=floats(9),
    distance=floats(DEEP),
    neighbour=whole(DEEP),
    stack=whole(64),
    bound=floats(64 + LEAF_SIZE),
    candidates=floats(CANDIDATE_ROWS, LANES),
    seed=floats(DOF),
    found=floats(LANES, DOF),
    state=whole(LANES),
    best=floats(LANES, DOF),
    best_error=floats(LANES),
    floor=floats(LANES),
    columns=floats(3),
    damping=floats(1),
)
"""Layout of the scratch memory of an arm."""


scratch_size, lay_scratch = LAYOUT.size, LAYOUT.make


@array_view
def make_scratch(memory: Array, dof: int, joints: int) -> Scratch:
    """Create the views of a scratch memory in a block of `scratch_size` numbers."""
    scratch: Scratch = lay_scratch(memory.ctypes.data, dof, joints)
    return scratch
