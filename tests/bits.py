"""Digests of answers of some arms to every kind of question: ``python -m tests.bits``.

Two states, two ways of running kernels or two machines agree bit for bit where these lines do.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from typing import Any

import numpy as np

import kinseek
from kinseek import Goal

ARMS = ("planar2", "scara4", "ur5e", "panda")


def digest(*arrays: Any) -> str:
    """Of the bits of numbers."""
    every = hashlib.sha256()
    for array in arrays:
        every.update(np.ascontiguousarray(array).tobytes())
    return every.hexdigest()[:12]


def digests(name: str) -> Iterator[tuple[str, str]]:
    """What was asked of an arm, and the digest of what came of it."""
    arm = kinseek.load(name)
    rng = np.random.default_rng(5)
    q = rng.uniform(arm.lower, arm.upper, (64, arm.dof))
    poses = arm.fk(q)
    yield "poses", digest(poses)
    yield "jacobians", digest(arm.jacobian(q))
    solution = arm.ik(poses, threads=1)
    yield "batch", digest(solution.q, solution.position_error, solution.weighted_error, solution.evaluations)
    yield "one by one", digest([arm.ik(pose).q for pose in poses[:30]])
    yield (
        "near, one by one",
        digest([arm.ik(pose, near=one + 0.05).q for pose, one in zip(poses[:30], q, strict=False)]),
    )
    yield "near, batch", digest(arm.ik(poses, near=q, threads=1).q)
    far = poses[:4].copy()
    far[:, :3, 3] *= 1.6
    solution = arm.ik(far)
    yield "out of reach", digest(solution.q, solution.weighted_error)
    yield "positions", digest(arm.ik(Goal.position(poses[:10, :3, 3])).q)
    yield "directions", digest(arm.ik(Goal.pointing(poses[:10, :3, 3], poses[0, :3, 2])).q)
    yield "ranges", digest(arm.ik(Goal.pose(poses[:10], free="rz", box={"x": (-0.01, 0.02)})).q)
    yield "branches", digest(*[arm.branches(pose).q for pose in poses[:4]])
    every = arm.branches(poses[:8])
    assert isinstance(every, kinseek.BranchesBatch)
    yield "branches, batch", digest(*[each.q for each in every])
    certificates = [arm.prove(pose, budget=4000) for pose in far[:2]]
    yield "proofs", digest([each.lower_bound for each in certificates], [each.boxes for each in certificates])
    certificates = [arm.prove(pose, gap=0.1, budget=500) for pose in far[:1]]
    yield "bounds", digest([each.lower_bound for each in certificates], [each.boxes for each in certificates])
    if arm.dof == 6:
        yield "all branches", digest(arm.branches(poses[0], prove=True).q)
    searches: tuple[kinseek.Solver, ...] = (
        kinseek.DivideAndConquer(breadth=1),
        kinseek.BruteForce(branching_factor=4),
        kinseek.CoordinateDescent(),
        kinseek.BlindSearch(most_steps=10),
    )
    for search in searches:
        solution = arm.ik(poses[:2], solver=search, near=q[:2] + 0.1)
        yield type(search).__name__, digest(solution.q, solution.evaluations)


def main() -> None:
    """Print all of them."""
    for name in ARMS:
        for what, told in digests(name):
            print(f"{name}: {what}: {told}")


if __name__ == "__main__":
    main()
