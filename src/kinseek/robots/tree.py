"""From a tree of named frames to the one path between a base and a tip."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping

from kinseek.errors import InvalidRobot, suggest

_LISTED = 40
"""Possible tips that a message names at most."""


def frame_path(
    parents: Mapping[str, str | None],
    base: str | None,
    tip: str | None,
    *,
    ends: Collection[str],
    noun: str,
    moving: Collection[str],
) -> list[str]:
    """Names of the frames from base to tip, both included.

    Args:
        parents: Of each frame: the frame it hangs on, None for the root. One root, no loops.
        base: First frame of the path; the root unless given.
        tip: Last frame of the path; the only one of `ends` below the base unless given.
        ends: The frames that nothing hangs on and that may be taken as the tip unasked.
        noun: What the file calls a frame, for messages.
        moving: The frames that a joint moves against the frame they hang on.

    Raises:
        InvalidRobot: An unknown name, several possible tips, or a base that is not above the tip.
    """
    for frame in (base, tip):
        if frame is not None and frame not in parents:
            raise InvalidRobot(suggest(frame, parents, noun))
    if base is None:
        base = next(frame for frame, parent in parents.items() if parent is None)
    if tip is None:
        tip = _only_end(parents, base, ends, noun, moving)

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


def _only_end(
    parents: Mapping[str, str | None],
    base: str,
    ends: Collection[str],
    noun: str,
    moving: Collection[str],
) -> str:
    below = dict.fromkeys(_below(parents, base))
    found = [frame for frame in ends if frame in below]
    if len(found) == 1:
        return found[0]
    tips = _usual_tips(parents, base, below, moving)
    listed = ", ".join(tips[:_LISTED]) + (f" and {len(tips) - _LISTED} more" if len(tips) > _LISTED else "")
    raise InvalidRobot(
        f"the arm branches below base {base!r}. Choose tip= from: {listed or 'none'}"
        + (f"; any other {noun} that moves against the base will do, too" if tips else "")
    )


def _usual_tips(
    parents: Mapping[str, str | None], base: str, below: Collection[str], moving: Collection[str]
) -> list[str]:
    """Frames that people take as a tip: where the tree branches, as at the palm of a hand, and where it ends.

    Only those between which and the base a joint moves, in the order in which they come from the base.
    """
    children = Counter(parent for frame, parent in parents.items() if parent in below)
    depth, moves = {base: 0}, {base: False}
    for frame in below:  # Parents before their children.
        parent = parents[frame]
        if frame != base and parent is not None:
            depth[frame], moves[frame] = depth[parent] + 1, moves[parent] or frame in moving
    tips = [frame for frame in below if children[frame] != 1 and moves[frame]]
    return sorted(tips, key=lambda frame: (children[frame] == 0, depth[frame], frame))


def _below(parents: Mapping[str, str | None], base: str) -> list[str]:
    """The base and all frames below it, parents before their children."""
    children: dict[str | None, list[str]] = {}
    for frame, parent in parents.items():
        children.setdefault(parent, []).append(frame)
    found = [base]
    for frame in found:  # It grows as it is read.
        found += children.get(frame, [])
    return found
