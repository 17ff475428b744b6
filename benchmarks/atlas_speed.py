"""The atlas: one pose by `arm.ik`, its kernel alone, batches, out of reach, and building.

Compares kinseek with the targets in benchmarks/README.md. Single calls go through 1,000 targets in order. `extra_info`
holds the median and the 99th percentile [µs] of 5,000 calls that are timed one by one, or the cost of one pose.
Run: pytest benchmarks/atlas_speed.py --benchmark-only
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import cycle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import kinseek
from benchmarks.command import under_pytest
from benchmarks.targets import plain_fk, random_joints
from benchmarks.timing import timed
from kinseek.kernels.atlas.one_goal import solve_plain
from kinseek.kinds import POSE
from kinseek.solvers.atlas.index import SAMPLES, AtlasIndex, atlas_of

Array = NDArray[np.float64]

ARMS = ("panda", "ur5e", "iiwa14")


def targets_of(arm: kinseek.Arm, count: int, seed: int = 0) -> Array:
    return plain_fk(arm.chain, random_joints(arm.chain, count, seed))


def in_turn(function: Callable[[Array], Any], targets: Array) -> Callable[[], Any]:
    rest = cycle(list(targets))
    return lambda: function(next(rest))


@pytest.mark.parametrize("name", ARMS)
def test_one_pose(benchmark: Any, name: str) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 1000)
    timed(arm.ik, targets)
    _, times = timed(arm.ik, np.tile(targets, (5, 1, 1)))
    benchmark.extra_info["median_us"] = float(np.median(times))
    benchmark.extra_info["p99_us"] = float(np.percentile(times, 99))
    benchmark.pedantic(in_turn(arm.ik, targets), rounds=20, iterations=1000, warmup_rounds=1)


@pytest.mark.parametrize("name", ARMS)
def test_kernel_alone(benchmark: Any, name: str) -> None:
    arm = kinseek.load(name)
    address, targets, q = atlas_of(arm.chain).address, targets_of(arm, 1000), np.empty(arm.dof)

    def solve(target: Array) -> Any:
        return solve_plain(address, target, q)

    _, times = timed(solve, np.tile(targets, (5, 1, 1)))
    benchmark.extra_info["median_us"] = float(np.median(times))
    benchmark.extra_info["p99_us"] = float(np.percentile(times, 99))
    benchmark.pedantic(in_turn(solve, targets), rounds=20, iterations=1000, warmup_rounds=1)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("name", ARMS)
def test_batch(benchmark: Any, name: str, threads: int) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 100_000)
    benchmark.pedantic(arm.ik, (targets,), {"threads": threads}, rounds=5, warmup_rounds=1)
    if benchmark.stats is not None:
        benchmark.extra_info["us_per_pose"] = benchmark.stats.stats.median / len(targets) * 1e6


@pytest.mark.parametrize("name", ARMS)
def test_near_a_start(benchmark: Any, name: str) -> None:
    arm = kinseek.load(name)
    q = random_joints(arm.chain, 1, 0)[0]
    benchmark(arm.ik, plain_fk(arm.chain, q[None])[0], near=q + 0.02)


@pytest.mark.parametrize("name", ARMS)
def test_out_of_reach(benchmark: Any, name: str) -> None:
    arm = kinseek.load(name)
    targets = targets_of(arm, 200)
    length = np.linalg.norm(arm.chain.fixed[:, :, 3], axis=1).sum()
    targets[:, :3, 3] *= 1.5 * length / np.linalg.norm(targets[:, :3, 3], axis=1)[:, None]
    benchmark.pedantic(in_turn(arm.ik, targets), rounds=10, iterations=200, warmup_rounds=1)


@pytest.mark.parametrize("name", ARMS)
def test_build(benchmark: Any, name: str) -> None:
    arm = kinseek.load(name)
    index = benchmark(AtlasIndex, arm.chain, POSE, arm.chain.arrays, SAMPLES)
    benchmark.extra_info["megabytes"] = index.memory / 1e6


if __name__ == "__main__":
    under_pytest(__file__, __doc__)
