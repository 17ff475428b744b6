"""Redundant arms: which curves of the self-motion does the sample of `arm.branches` miss?

Searches from random starts (`near=`) find solutions everywhere. A solution that is far from every solution of the sample is
followed along its curve, both ways, until a limit or once around. If no solution of the sample lies on it, the sample
misses this curve. The curve is followed by plain steps in the null space, each brought back onto the pose by plain Newton
steps.

    python -m benchmarks.self_motion
    python -m benchmarks.self_motion panda --targets 20 --restarts 400
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek

from .command import arm_name, at_least_one, command
from .targets import plain_fk, random_joints, strict

Array = NDArray[np.float64]

ARMS = ("panda", "iiwa14", "gen3")

STEP, LONGEST = 0.03, 1000
"""Steps along a curve [rad], and how many at most."""

NEAR = 0.3
"""An answer this close to one of the sample [rad] is not followed."""


def apart(a: Array, b: Array) -> Array:
    """Distances of all pairs modulo full turns, (k, n) and (l, n) -> (k, l)."""
    gap = (a[:, None] - b[None] + np.pi) % (2 * np.pi) - np.pi
    return np.asarray(np.linalg.norm(gap, axis=-1))


def along(arm: kinseek.Arm, q: Array, target: Array, way: int) -> Array:
    """The self-motion from q until a limit, or once round, (k, n)."""
    rows, before = [q], np.zeros(arm.dof)
    for _ in range(LONGEST):
        null = np.linalg.svd(arm.jacobian(q))[2][-1]
        null = way * null if len(rows) == 1 else null * np.copysign(1.0, null @ before)
        q, before = q + STEP * null, null
        for _ in range(4):
            pose = arm.fk(q)
            turn = Rotation.from_matrix(target[:3, :3] @ pose[:3, :3].T).as_rotvec()
            off = np.concatenate([target[:3, 3] - pose[:3, 3], turn])
            q = q + np.linalg.pinv(arm.jacobian(q), rcond=1e-4) @ off
        beyond = (q < arm.lower - 1e-6) | (q > arm.upper + 1e-6)
        round_once = len(rows) > 10 and apart(q[None], rows[0][None])[0, 0] < STEP / 2
        if (beyond & ~arm.chain.endless).any() or round_once:
            break
        rows.append(q)
    return np.array(rows)


def missed_curves(arm: kinseek.Arm, target: Array, sample: Array, restarts: int, seed: int) -> list[Array]:
    """Curves that restarts find and the sample, (k, n), has no answer on."""
    starts = np.random.default_rng(seed).uniform(arm.lower, arm.upper, (restarts, arm.dof))
    found = arm.ik(np.broadcast_to(target, (restarts, 4, 4)), near=starts, threads=1)
    rest, curves = found.q[found.success], []
    rest = rest[strict(arm.chain, rest, np.broadcast_to(target, (len(rest), 4, 4)))]
    rest = rest[apart(rest, sample).min(axis=1, initial=np.inf) > NEAR]
    while len(rest):
        curve = np.concatenate([along(arm, rest[0], target, way) for way in (1, -1)])
        if apart(curve, sample).min(initial=np.inf) > 2 * STEP:
            curves.append(curve)
        rest = rest[1:][apart(rest[1:], curve).min(axis=1) > 2 * STEP]
    return curves


def main() -> None:
    """Print one line an arm."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", type=arm_name, help=f"bundled arms; {', '.join(ARMS)} if left out")
    parser.add_argument("--targets", type=at_least_one, default=100)
    parser.add_argument("--restarts", type=at_least_one, default=1000)
    parser.add_argument("--seed", type=int, default=9)
    given = parser.parse_args()
    print("arm       targets  missing a curve  curves missed  shortest and longest [rad]")
    for name in given.arms or ARMS:
        arm, whole, lengths = kinseek.load(name), 0, list[float]()
        targets = plain_fk(arm.chain, random_joints(arm.chain, given.targets, given.seed))
        for i, target in enumerate(targets):
            sample = arm.branches(target)
            assert isinstance(sample, kinseek.Branches)
            curves = missed_curves(arm, target, sample.q, given.restarts, given.seed + i)
            whole += not curves
            lengths += [STEP * len(curve) for curve in curves]
        span = f"{min(lengths):.2f} to {max(lengths):.2f}" if lengths else "–"
        print(f"{name:9} {len(targets):7} {len(targets) - whole:16} {len(lengths):14}  {span}", flush=True)


if __name__ == "__main__":
    main()
