"""How many answers a peer hands back for every target where all inside the limits are asked for, and how long that takes.

Runs in the peer's environment, beside `worker.py`.

    python branches_worker.py PEER INPUT.npz OUTPUT.npz
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from worker import ssik_artifact, work


def ssik(arm: Any) -> Callable[[Any], Any]:
    """The artifact that ``ssik build`` writes for an arm; answers that differ by full turns count once."""
    artifact = ssik_artifact(arm)
    return lambda T: artifact.solve(T, enumerate_windings=False)


def main() -> None:
    """Ask for all; the first answer is written down, and how many there are."""
    work(__doc__, {"ssik": ssik}, 50, lambda found: (found[0].q if found else None, len(found)))


if __name__ == "__main__":
    main()
