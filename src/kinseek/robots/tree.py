"""From a tree of named frames to the one path between a base and a tip."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from kinseek.errors import InvalidRobot, suggest


def frame_path(
    parents: Mapping[str, str | None], base: str | None, tip: str | None, *, ends: Collection[str], noun: str
) -> list[str]:
    """Names of the frames from base to tip, both included.

    Args:
        parents: Of each frame: the frame it hangs on, None for the root. One root, no loops.
        base: First frame of the path; the root unless given.
        tip: Last frame of the path; the only one of `ends` below the base unless given.
        ends: The frames that nothing hangs on and that may be taken as the tip unasked.
        noun: What the file calls a frame, for messages.

    Raises:
        InvalidRobot: An unknown name, several possible tips, or a base that is not above the tip.
    """
    for frame in (base, tip):
        if frame is not None and frame not in parents:
            raise InvalidRobot(suggest(frame, parents, noun))
    if base is None:
        base = next(frame for frame, parent in parents.items() if parent is None)
    if tip is None:
        tip = _only_end(parents, base, ends, noun)

    above = _root_to(parents, tip)
    if base not in above:
        raise InvalidRobot(
            f"base {base!r} is not above tip {tip!r}. "
            f"Above it, from the root: {', '.join(above[:-1]) or 'none'}"
        )
    return above[above.index(base) :]


def _root_to(parents: Mapping[str, str | None], frame: str) -> list[str]:
    path = [frame]
    while (parent := parents[path[-1]]) is not None:
        path.append(parent)
    return path[::-1]


def _only_end(parents: Mapping[str, str | None], base: str, ends: Collection[str], noun: str) -> str:
    below = [frame for frame in ends if base in _root_to(parents, frame)]
    if len(below) != 1:
        raise InvalidRobot(
            f"the arm branches: {len(below)} {noun}s below base {base!r} have nothing below them. "
            f"Choose tip= from: {', '.join(sorted(below)) or 'none'}"
        )
    return below[0]
