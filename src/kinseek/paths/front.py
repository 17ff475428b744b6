"""Turn the arguments of `Arm.follow` into a `Path`."""

from __future__ import annotations

from typing import Any

from kinseek.errors import PathInterrupted
from kinseek.robots.mechanism import Mechanism
from kinseek.solvers.threads import progress_bar

from .arguments import goals_of, read
from .follow import follow
from .path import Path
from .proofs import with_proofs


def follow_poses(
    arm: Mechanism, Ts: Any, options: dict[str, Any], prove: bool, threads: int | None, progress: bool
) -> Path:
    """Read the poses and the options, and follow the poses; see `Arm.follow` for what is raised."""
    goal, broken = goals_of(Ts)
    if broken is not None:
        # The given times and the given end belong to all poses, so they do not apply to the poses that were read.
        options = options | {"end": None, "times": None, "closed": False}
    request = read(arm, goal, **options)
    with progress_bar(progress, len(goal.targets)) as advance:
        path = follow(request, threads, advance)
    if prove:
        path = with_proofs(request, path, threads)
    if broken is not None:
        raise PathInterrupted(
            f"the iterator raised {type(broken).__name__} after {len(path)} poses: {broken}; the path through them is "
            f"in the error's .path",
            path,
        ) from broken
    return path
