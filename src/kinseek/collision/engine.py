"""Exact collision checks by coal through pinocchio, on a model built from the arm's own fixed transforms."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidScene
from kinseek.kernels.collision.gaps import DOUBT, FREE
from kinseek.robots.chain import SerialChain
from kinseek.support.forks import Lock

from .broad import Broad
from .clouds import Cloud
from .geometry import library
from .shapes import Mesh, Shape
from .share import share

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

TOUCH = 1e-6
"""Parts closer than this touch [m]: the accuracy of coal's distances."""

_UNKNOWN = float(np.finfo(np.float64).min)
"""What coal says of parts that touch, where it cannot report how deep they are in each other: of very small triangles."""

MOST_JOINTS = 150
"""Maximum number of moving joints of an arm. pinocchio keeps 36 bytes for the cube of their number, in two models: 0.24 GB
for 150 joints, and 70 GB for the 1,000 that a file may have."""

LOOKS = 24
"""Number of planes tried between parts that may be the nearest. Not examined further."""

_ALONE = 1024
"""Number of joint values up to which starting another thread does not pay. Not examined further."""

_CHUNKS, _SHORTEST = 8, 256
"""Number of pieces per thread into which a batch is divided, and minimum number of joint values in each. Not examined
further."""


class Solid(NamedTuple):
    """One part of a body, as the engine takes it."""

    joint: int
    """The joint that carries it; 0 if it is fixed in the base."""
    shape: Shape
    pose: Array
    """Pose in the frame of that joint, (4, 4), lengths in [m]."""
    padding: float
    """Added to it on every side [m]."""


class Near(NamedTuple):
    """The distance of two parts."""

    pair: int
    distance: float
    """Distance [m], negative if they penetrate."""
    points: tuple[Array, Array]
    """Nearest points on each of them, in the base, (3,) each [m]."""


def joints_of(chain: SerialChain) -> tuple[Any, Any]:
    """Return the joints of an arm for pinocchio, and its memory for them, which grows with the cube of their number.

    Raises:
        InvalidScene: The arm has too many joints.
    """
    if (count := len(chain.prismatic)) > MOST_JOINTS:
        raise InvalidScene(
            f"{count:,} moving joints, expected at most {MOST_JOINTS} in a scene: lock some of them with with_locked()"
        )
    pin = library("pinocchio")
    model, joint = pin.Model(), 0
    for k, slides in enumerate(chain.prismatic):
        kind = pin.JointModelPZ() if slides else pin.JointModelRZ()
        place = pin.SE3(chain.fixed[k, :, :3].copy(), chain.fixed[k, :, 3].copy())
        # The model has one joint per physical joint, so that mimic joints and offsets need no support by pinocchio.
        joint = model.addJoint(joint, kind, place, f"joint{k + 1}")
    return model, model.createData()


class Engine:
    """Collision checks of the checked pairs of a scene, used by one thread at a time, ``with engine.lock:``.

    Args:
        chain: The arm.
        solids: All parts.
        pairs: Numbers of the two parts of each checked pair.
        joints: What `joints_of` returns, if several engines share it and are used one after the other.
    """

    def __init__(
        self,
        chain: SerialChain,
        solids: Sequence[Solid],
        pairs: Sequence[tuple[int, int]],
        joints: tuple[Any, Any] | None = None,
    ) -> None:
        """Build the models of pinocchio and coal."""
        self._pin = pin = library("pinocchio")
        self._chain, self.solids, self.pairs = chain, list(solids), pairs
        self._model, self._data = joints_of(chain) if joints is None else joints
        self._geometry = pin.GeometryModel()
        for number, solid in enumerate(solids):
            place = pin.SE3(solid.pose[:3, :3].copy(), solid.pose[:3, 3].copy())
            self._geometry.addGeometryObject(
                pin.GeometryObject(str(number), solid.joint, place, solid.shape.geometry())
            )
        for i, j in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(i, j))
        self._placed = pin.GeometryData(self._geometry)
        # Every pair starts from a fresh guess, which pinocchio's requests do not: results would depend on previous checks.
        coal = library("coal")
        fresh, distance = coal.CollisionRequest(), coal.DistanceRequest()
        fresh.enable_contact = False
        for n in range(len(pairs)):
            self._placed.collisionRequests[n], self._placed.distanceRequests[n] = fresh, distance
        self._larger = np.array(
            [sum(solids[i].padding + solids[i].shape.excess for i in pair) for pair in pairs]
        ).reshape(-1)
        self._padded = np.array([sum(solids[i].padding for i in pair) for pair in pairs]).reshape(-1)
        self._clearance, self._lock = np.nan, Lock()
        self._fitted: Broad | None = None
        # coal knows only the surface of such a mesh: a part wholly inside it does not touch, and is tested separately.
        self._shells = [n for n, pair in enumerate(pairs) if any(_is_shell(solids[i]) for i in pair)]

    @property
    def lock(self) -> Any:
        """The lock of the engine, a reentrant one of Python: it keeps placements between calls.

        Ctrl-C may come between any two instructions of a context manager in Python, and would leave the engine locked.
        """
        return self._lock.now

    @property
    def broad(self) -> Broad:
        """The broad phase, fitted by one thread at its first use, which may take seconds."""
        fitted = self._fitted
        if fitted is None:
            with self.lock:
                # Another thread may have fitted it while this one waited.
                fitted = self._fitted or Broad(self._chain, self.solids, self.pairs, self._padded)
                self._fitted = fitted
        return fitted

    def stand(self, poses: Mapping[int, Array]) -> None:
        """Move parts that are fixed in the base: their numbers, and their new poses, (4, 4)."""
        for number, pose in poses.items():
            self.solids[number] = self.solids[number]._replace(pose=pose)
            place = self._pin.SE3(pose[:3, :3].copy(), pose[:3, 3].copy())
            self._geometry.geometryObjects[number].placement = place
        # The spheres of the broad phase contain the old poses.
        self._fitted = None

    def free(self, q: Array, clearance: float, threads: int | None = 1) -> Flags:
        """Return whether every pair is farther apart than `clearance`, (k, n) -> (k,).

        The broad phase decides most joint values; for the others coal checks the pairs in doubt. The method itself acquires
        the engine for coal.
        """
        if not self.pairs:
            return np.ones(len(q), dtype=np.bool_)
        workers = 1 if len(q) <= _ALONE else threads or os.cpu_count() or 1
        if workers == 1:
            return self._free(q, clearance)
        free, chunk = np.empty(len(q), dtype=np.bool_), max(len(q) // (_CHUNKS * workers), _SHORTEST)

        def work(first: int) -> None:
            free[first : first + chunk] = self._free(q[first : first + chunk], clearance)

        share(work, range(0, len(q), chunk), workers)
        return free

    def verdict(self, q: Array) -> int:
        """Return what the broad phase finds for one q: `FREE`, `TOUCH` or `DOUBT`, also for all but n floats."""
        if not self.pairs or q.dtype != np.float64 or q.shape != (self._chain.dof,):
            return DOUBT
        return int((self._fitted or self.broad).verdicts(q[None], 0.0, TOUCH)[0][0])

    def _free(self, q: Array, clearance: float) -> Flags:
        broad = self.broad
        verdicts, in_doubt = broad.verdicts(q, clearance, TOUCH)
        if not in_doubt:
            return np.asarray(verdicts == FREE)
        rows = np.flatnonzero(verdicts == DOUBT)
        _, doubts = broad.sort_out(q[rows], clearance, TOUCH)
        with self.lock:
            if self._fitted is not broad:
                # Bodies have moved meanwhile; while this holds the engine, they do not.
                return self._free(q, clearance)
            free = np.asarray(verdicts == FREE)
            self.set_clearance(clearance)
            for k, pairs in zip(rows, doubts, strict=True):
                self.place(q[k])
                free[k] = not any(self.touch(n) for n in np.flatnonzero(pairs).tolist())
        return free

    def free_samples(
        self, q: Array, way: Array, counts: NDArray[np.int64], clearance: float
    ) -> NDArray[np.int64]:
        """Return how many samples of linear motions are free before the first that is not; see `Broad.free_samples`."""
        if not self.pairs:
            return counts.copy()
        free = self.broad.free_samples(q, way, counts, clearance, TOUCH)
        for k in np.flatnonzero(free < 0).tolist():
            shares = np.arange(1, counts[k] + 1)[:, None] / counts[k]
            free[k] = np.argmin(np.append(self._free(q[k] + shares * way[k], clearance), False))
        return free

    def exactly_free(self, q: Array, clearance: float) -> Flags:
        """Do the same by coal alone, pair by pair, because coal's tree of boxes misses flat meshes."""
        self.set_clearance(clearance)
        return np.array([self._is_free(one) for one in q], dtype=np.bool_)

    def bounds(self, q: Array, steps: int = 0) -> Array:
        """Return lower bounds on the distance of each pair, with padding, (k, n) -> (k, pairs) [m]; see `Broad.bounds`."""
        return self.broad.bounds(q, steps)

    def near(self, q: Array) -> list[Near]:
        """Return the distances of all pairs at q, (n,)."""
        self.place(q)
        return [self.near_pair(n) for n in range(len(self.pairs))]

    def nearest(self, q: Array) -> Near | None:
        """Return the two parts that are nearest to each other at q, (n,); None without pairs."""
        if not self.pairs:
            return None
        bounds = self.broad.bounds(q[None], LOOKS)[0]
        self.place(q)
        best: Near | None = None
        # In the order of their bounds, so that few distances are computed exactly.
        for n in np.argsort(bounds):
            # A bound below 0 has no meaning: spheres do not measure penetration depth.
            if best is not None and bounds[n] > max(best.distance, 0.0):
                break
            found = self.near_pair(int(n))
            if best is None or found.distance < best.distance:
                best = found
        return best

    def touching(self, q: Array, clearance: float) -> list[Near]:
        """Return the parts that are at most `clearance` apart at q, (n,), with their distances."""
        if not self.pairs:
            return []
        self.set_clearance(clearance)
        # The bounds exclude most pairs, and cost less than one exact check.
        close = np.flatnonzero(self.bounds(q[None])[0] <= clearance + TOUCH)
        self.place(q)
        return [self.near_pair(int(n)) for n in close if self.touch(int(n))]

    def is_convex(self, n: int) -> bool:
        """Return whether both parts of a pair are convex."""
        return not any(
            isinstance(self.solids[i].shape, Cloud) or _is_shell(self.solids[i]) for i in self.pairs[n]
        )

    def larger(self, n: int) -> float:
        """Return how much smaller the distance of a pair is than the distance of its coal shapes [m]."""
        return float(self._larger[n])

    def set_clearance(self, clearance: float) -> None:
        """Set the distance up to which parts touch [m]."""
        if clearance == self._clearance:
            return
        self._clearance = np.nan  # Ctrl-C or a fork may interrupt before all requests have it.
        for request, larger in zip(self._placed.collisionRequests, self._larger, strict=True):
            request.security_margin = clearance + larger + TOUCH
        self._clearance = clearance

    def place(self, q: Array) -> None:
        """Update the placements of all parts for q, (n,)."""
        self._pin.updateGeometryPlacements(
            self._model, self._data, self._geometry, self._placed, self._physical(q)
        )

    def _is_free(self, q: Array) -> bool:
        self.place(q)
        if self._pin.computeCollisions(self._geometry, self._placed, True):
            return False
        return not any(self._inside(n) for n in self._shells)

    def _physical(self, q: Array) -> Array:
        return np.asarray(self._chain.multiplier * q[self._chain.leader] + self._chain.offset)

    def touch(self, n: int) -> bool:
        """Return whether the parts of a pair touch at the last placements."""
        return bool(self._pin.computeCollision(self._geometry, self._placed, n)) or self._inside(n)

    def near_pair(self, n: int) -> Near:
        """Return the distance of a pair at the last placements."""
        result = self._pin.computeDistance(self._geometry, self._placed, n)
        distance = float(result.min_distance)
        # Parts that touch without a known depth count as in contact with depth 0.
        if distance <= _UNKNOWN:
            distance = 0.0
        if self._inside(n):
            distance = -abs(distance)
        points = np.array(result.getNearestPoint1()), np.array(result.getNearestPoint2())
        return Near(n, distance - float(self._larger[n]), points)

    def _inside(self, n: int) -> bool:
        """Return whether one part is wholly inside a closed mesh, of which coal knows only the surface.

        The other part is connected. So if the surfaces do not intersect, testing any one of its points is enough. The mean
        of the corners of a hull lies in the hull; the middle of their bounding box may lie outside.
        """
        for shell, other in (self.pairs[n], self.pairs[n][::-1]):
            if not _is_shell(self.solids[shell]):
                continue
            point = self._placed.oMg[other].act(self.solids[other].shape.corners.mean(axis=0))
            mesh = self.solids[shell].shape
            if isinstance(mesh, Mesh) and mesh.holds(np.asarray(self._placed.oMg[shell].actInv(point))):
                return True
        return False


def _is_shell(solid: Solid) -> bool:
    return isinstance(solid.shape, Mesh) and not solid.shape.hull
