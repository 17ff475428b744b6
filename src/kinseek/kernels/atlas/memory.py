"""Scratch memory of a call, allocated in one block."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined
from kinseek.kernels.layout import Layout

from .lanes import LANES, Lanes
from .task import Job, Task
from .tree import LEAF_SIZE

DEEP = 160
"""Largest number of samples looked up for one goal."""


CANDIDATE_ROWS = 18
"""Rows of the candidates of a closed form, see `structure.candidates.WORK`."""


class Scratch(NamedTuple):
    """Scratch memory of one call."""

    lanes: Lanes
    seen: Annotated[Array, 3, 4]
    """The goal as the atlas sees it, (3, 4)."""
    spare: Annotated[Array, 3, 4]
    """(3, 4)"""
    between: Annotated[Array, 3, 4]
    """(3, 4)"""
    point: Annotated[Array, 9]
    """Coordinates of the goal among the samples, (9,)."""
    distance: Annotated[Array, DEEP]
    """(DEEP,)"""
    neighbour: Annotated[Indices, DEEP]
    """(DEEP,)"""
    stack: Annotated[Indices, 64]
    """(64,)"""
    bound: Annotated[Array, 64 + LEAF_SIZE]
    """(64 + LEAF_SIZE,)"""
    candidates: Annotated[Array, CANDIDATE_ROWS, LANES]
    """Candidates of a closed form, one in each lane, (CANDIDATE_ROWS, LANES)."""
    seed: Annotated[Array, "dof"]
    """(n,)"""
    found: Annotated[Array, LANES, "dof"]
    """Joint values at which each lane converged, (LANES, n)."""
    state: Annotated[Indices, LANES]
    """State of each lane: 0 active, 1 converged, 2 empty, 3 given up, (LANES,)."""
    best: Annotated[Array, LANES, "dof"]
    """Best joint values found, (LANES, n)."""
    best_error: Annotated[Array, LANES]
    """Their weighted errors, (LANES,)."""
    floor: Annotated[Array, LANES]
    """Smallest damping of each lane, (LANES,)."""
    columns: Annotated[Array, 3]
    """Weights of the columns in the step, (3,)."""
    damping: Annotated[Array, 1]
    """Factor from the squared error to the damping of the step, (1,)."""


LAYOUT = Layout(Scratch)
"""Layout of the scratch memory of an arm."""


scratch_size, lay_scratch = LAYOUT.size, LAYOUT.make


@inlined
def scratch_of(job: Job, task: Task) -> Scratch:
    """The scratch memory of a job."""
    return make_scratch(job.memory, len(task.lower), len(task.chain.leader))


@inlined
def make_scratch(memory: Array, dof: int, joints: int) -> Scratch:
    """Create the views of a scratch memory in a block of `scratch_size` numbers."""
    scratch: Scratch = lay_scratch(memory.ctypes.data, dof, joints)
    return scratch
