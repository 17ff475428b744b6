"""Scratch memory of a call, allocated in one block."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from kinseek.kernels.arrays import Array, Indices
from kinseek.kernels.jit import inlined
from kinseek.kernels.layout import Layout

from .lanes import LANES, Lanes
from .samples import COORDINATES
from .task import REPORT, Job, Task
from .tree import BESIDE, LEAF_SIZE, MOST_LEVELS

DEEP = 160
"""Largest number of samples looked up for one goal."""

CANDIDATE_ROWS = 18
"""Rows of the candidates of a closed form, see `structure.candidates.WORK`."""

ACTIVE, CONVERGED, EMPTY, GIVEN_UP = 0, 1, 2, 3
"""States of a lane."""


class Scratch(NamedTuple):
    """Scratch memory of one call."""

    lanes: Lanes
    seen: Annotated[Array, 3, 4]
    """The goal as the atlas sees it, (3, 4)."""
    pose: Annotated[Array, 3, 4]
    """The pose of the tip that is judged next, (3, 4); every use overwrites it."""
    between: Annotated[Array, 3, 4]
    """The goal relative to the first joint, on the way to `seen`, (3, 4)."""
    displacement: Annotated[Array, 3, 4]
    """The displacement of a closed form, see `structure.candidates`, (3, 4)."""
    rest: Annotated[Array, 3, 4]
    """The same without the swept joint, (3, 4)."""
    point: Annotated[Array, COORDINATES]
    """Coordinates of the goal among the samples, (COORDINATES,)."""
    distance: Annotated[Array, DEEP]
    """Squared distances of a look-up, (DEEP,), see `tree.Neighbours`."""
    neighbour: Annotated[Indices, DEEP]
    """Its samples, (DEEP,)."""
    stack: Annotated[Indices, MOST_LEVELS]
    """(MOST_LEVELS,)"""
    bound: Annotated[Array, MOST_LEVELS]
    """(MOST_LEVELS,)"""
    leaf: Annotated[Array, LEAF_SIZE]
    """(LEAF_SIZE,)"""
    beside: Annotated[Array, BESIDE, LEAF_SIZE]
    """Squared distances of a scan, (BESIDE, LEAF_SIZE), see `tree.scan_beside`."""
    least: Annotated[Array, LEAF_SIZE]
    """The smallest of them at each place of the leaves, (LEAF_SIZE,)."""
    report: Annotated[Array, REPORT]
    """Report on the last joint values that were judged, see `task.POSITION_ERROR`, (REPORT,)."""
    candidates: Annotated[Array, CANDIDATE_ROWS, LANES]
    """Candidates of a closed form, one in each lane, (CANDIDATE_ROWS, LANES)."""
    seed: Annotated[Array, "dof"]
    """(n,)"""
    found: Annotated[Array, LANES, "dof"]
    """Joint values at which each lane converged, (LANES, n)."""
    state: Annotated[Indices, LANES]
    """State of each lane, see `ACTIVE`, (LANES,)."""
    paused: Annotated[Indices, LANES]
    """1 for a lane that repeats a step with more damping, see `ending.reweigh`, (LANES,)."""
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
