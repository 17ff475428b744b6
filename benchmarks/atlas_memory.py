"""Does memory grow? Resident memory during a million calls of `arm.ik` with one pose, and during a hundred batches.

python -m benchmarks.atlas_memory [CALLS]
"""

from __future__ import annotations

import gc
from pathlib import Path

import kinseek

from .command import at_least_one, command
from .targets import plain_fk, random_joints


def resident() -> float:
    """Resident memory of this process [MB]; Linux."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * 4096 / 1e6


def main() -> None:
    """Print resident memory after every tenth of the calls; fail if it grew by more than 1 MB after the first."""
    parser = command(__file__, __doc__)
    parser.add_argument(
        "calls", nargs="?", type=at_least_one, default=1_000_000, help="single calls, 1,000,000 by default"
    )
    calls = parser.parse_args().calls
    arm = kinseek.load("panda")
    targets = plain_fk(arm.chain, random_joints(arm.chain, 1000, 0))
    seen = []
    for part in range(10):
        for i in range(calls // 10):
            arm.ik(targets[i % 1000])
        for _ in range(10):
            arm.ik(targets)
        gc.collect()
        seen.append(resident())
        print(f"{(part + 1) * calls // 10:>10,} calls  {seen[-1]:.2f} MB", flush=True)
    if seen[-1] - seen[0] > 1.0:
        raise SystemExit(f"memory grew by {seen[-1] - seen[0]:.2f} MB")


if __name__ == "__main__":
    main()
