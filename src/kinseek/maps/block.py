"""The work of a worker: one block of a map. Each process builds an arm's atlas once."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.arm import Arm
from kinseek.collision import Scene
from kinseek.errors import InvalidMap
from kinseek.goal import Goal
from kinseek.kernels.sources import source_digest
from kinseek.robots import SerialChain
from kinseek.support.forks import Lock

from .cells import REACHED as TOUCHED
from .cells import UNDECIDED, Judge, cells_of_block
from .first_joint import FirstJoint, divided, turns
from .grid import Grid, Rings, grid_of
from .measures import REACHED, measured

Array = NDArray[np.float64]
Index = tuple[int, ...]


@lru_cache(maxsize=1)
def version() -> str:
    """Return the version of kinseek with a digest of the code that computes solutions; equal versions give equal bits."""
    return f"{kinseek.__version__}+{source_digest()}"


def digest(chain: SerialChain) -> str:
    """Return a digest of the data that an arm's solutions depend on: axes, limits, couplings."""
    sha = hashlib.sha256(repr(chain.kinds).encode())
    for array in (
        chain.fixed,
        chain.prismatic,
        chain.leader,
        chain.multiplier,
        chain.offset,
        chain.lower,
        chain.upper,
    ):
        sha.update(np.ascontiguousarray(array).tobytes())
    return sha.hexdigest()[:16]


@dataclass(frozen=True)
class Work:
    """All data that a worker needs; some kB."""

    chain: SerialChain
    arm: str
    """Digest of the arm."""
    grid: dict[str, Any]
    chunks: Index
    what: tuple[str, ...]
    position_tolerance: float
    orientation_tolerance: float
    patience: int | None
    prove: bool
    depth: int
    budget: int
    version: str
    store: str | None
    """Folder that the block is written to; None: the block is sent back."""
    scene: Scene | None = None
    """Scene in which solutions must be free of collision; its meshes make the work larger."""
    clearance: float = 0.0
    """Minimum distance between bodies of the scene [m]."""
    cell: str | None = None
    """Digest of the scene."""
    goal: Goal | None = None
    """What counts of each pose; None: all of it, within the tolerances."""
    map: str | None = None
    """Digest of the description in the store, which another map may replace; None is not compared."""

    def part(self, index: Index) -> tuple[slice, ...]:
        """Return the cells of a block."""
        return tuple(slice(i * n, (i + 1) * n) for i, n in zip(index, self.chunks, strict=True))


def slim(chain: SerialChain) -> SerialChain:
    """Return the arm as it is sent to workers: axes and limits, without its file."""
    return replace(chain, urdf=b"", packages={}, frames={}, source="")


class BlockScratch:
    """Data that a process keeps for an arm and a grid."""

    def __init__(self, work: Work) -> None:
        """Make the arm; its atlas is built when the first pose is solved."""
        self.grid: Grid | Rings = grid_of(work.grid)
        # Received arrays may be read-only, which kernels do not accept.
        chain = deepcopy(work.chain)
        self.first: FirstJoint | None = divided(chain) if isinstance(self.grid, Rings) else None
        self.arm = Arm(chain if self.first is None else self.first.chain)
        self.scene = deepcopy(work.scene)
        if self.scene is not None:
            self.scene.free(self.arm.sample(1))  # Fits its spheres now, outside the timed part.


_scratches: dict[str, BlockScratch] = {}
_making = Lock()


def scratch_of(work: Work) -> BlockScratch:
    """Return the scratch data of this process for this work; the last few are cached."""
    key = f"{work.arm} {work.cell} {sorted(work.grid.items())}"
    with _making.now:
        if key not in _scratches:
            while len(_scratches) > 3:
                _scratches.pop(next(iter(_scratches)))
            _scratches[key] = BlockScratch(work)
        return _scratches[key]


def compute(work: Work, index: Index) -> dict[str, Array]:
    """Solve the poses of one block: an array of each variable."""
    scratch = scratch_of(work)
    return answered(work, scratch, scratch.grid.poses(work.part(index)), work.part(index))


def answered(work: Work, scratch: BlockScratch, poses: Array, part: Sequence[slice]) -> dict[str, Array]:
    """Return an array of each variable for poses, (..., 4, 4), at the centres of a part of the grid's cells."""

    def goal(T: Array) -> Goal:
        if work.goal is not None:
            return work.goal.at(T)
        position, orientation = work.position_tolerance, work.orientation_tolerance
        return Goal.pose(T, position_tolerance=position, orientation_tolerance=orientation)

    free = int(scratch.first is not None)
    values = measured(scratch.arm, poses, work.what, goal, free, work.patience, scratch.scene, work.clearance)
    if scratch.first is not None:
        found = values[REACHED].ravel() == 1
        begins, ends = turns(scratch.first, scratch.arm, poses.reshape(-1, 4, 4), found, goal)
        values["turn_from"], values["turn_to"] = (each.reshape(found.shape) for each in (begins, ends))
        values = {name: each.reshape(poses.shape[:-2]) for name, each in values.items()}
    if work.prove:
        found = values[REACHED] == 1
        judge = Judge(scratch.arm, scratch.grid, work.depth, work.budget, goal(np.eye(4)))
        cells = cells_of_block(judge, part, found, wholly=scratch.scene is None)
        # A scene removes solutions: an empty cell stays empty, but other results for a cell were computed without the scene.
        if scratch.scene is not None:
            cells["cell"][(cells["cell"] == TOUCHED) & ~found] = UNDECIDED
        values |= cells
    return values


def do(work: Work, index: Index) -> dict[str, Array] | None:
    """Compute one block on a worker, and write it to the store or return it; a block that is written already is skipped.

    Raises:
        InvalidMap: The worker has another version of kinseek, or does not see the store.
        OSError: The block cannot be written.
    """
    if version() != work.version:
        raise InvalidMap(
            f"worker {_this_worker()} has kinseek {version()}, and this map is made with {work.version}; "
            "install the same version there"
        )
    if work.store is None:
        return compute(work, index)
    from .store import DIGEST, Store

    store = Store.at(work.store, _this_worker)
    if work.map is not None and store.description.get(DIGEST) != work.map:
        raise InvalidMap(f"another map has replaced the one in {work.store!r} while it was computed")
    if not store.is_done(index):
        store.write(index, compute(work, index))
    return None


def _this_worker() -> str:
    from distributed import get_worker

    try:
        return str(get_worker().address)
    except ValueError:  # Not a worker: this process.
        return "here"
