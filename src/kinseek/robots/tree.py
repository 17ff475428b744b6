"""Find the path between a base and a tip in a tree of named frames."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Mapping
from typing import NamedTuple

from kinseek.errors import InvalidRobot, suggest

_LISTED = 40
"""Largest number of candidate tips in a message."""


class TreePath(NamedTuple):
    """The path between two frames of a tree: from the base up to their common ancestor, and from there down to the tip."""

    up: list[str]
    """Names of the frames from the common ancestor to the base, both included."""
    down: list[str]
    """Names of the frames from the common ancestor to the tip, both included."""

    @property
    def names(self) -> list[str]:
        """Names of the frames from base to tip."""
        return [*self.up[:0:-1], *self.down]


def tree_path(parents: Mapping[str, str | None], base: str, tip: str) -> TreePath:
    """Return the path between two frames of a tree with one root."""
    above_base, above_tip = _root_to(parents, base), _root_to(parents, tip)
    shared = sum(1 for one, other in zip(above_base, above_tip, strict=False) if one == other)
    return TreePath(above_base[shared - 1 :], above_tip[shared - 1 :])


def frame_path(
    parents: Mapping[str, str | None],
    base: str | None,
    tip: str | None,
    *,
    ends: Collection[str],
    noun: str,
    moving: Collection[str],
) -> TreePath:
    """Return the path from base to tip; any two frames of the tree have one.

    Args:
        parents: Parent of each frame, None for the root. There is one root, and there are no loops.
        base: First frame of the path; the default is the root.
        tip: Last frame of the path; the default is the only one of `ends` below the base.
        ends: Frames without children that may be the default tip.
        noun: The file's word for a frame, for messages.
        moving: Frames that a joint moves relative to their parent.

    Raises:
        InvalidRobot: An unknown name, or several possible tips.
    """
    for frame in (base, tip):
        if frame is not None and frame not in parents:
            raise InvalidRobot(suggest(frame, parents, noun))
    if base is None:
        base = next(frame for frame, parent in parents.items() if parent is None)
    return tree_path(parents, base, _only_end(parents, base, ends, noun, moving) if tip is None else tip)


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
    if found == [base] and len(parents) > 1:
        root = _root_to(parents, base)[0]
        others = [tip for tip in _usual_tips(parents, root, _below(parents, root), moving) if tip != base]
        raise InvalidRobot(
            f"no {noun} is below base {base!r}, so tip= is needed. Choose it from: {_listed(others)}; "
            f"any other {noun} that moves against the base will do, too"
        )
    if len(found) == 1:
        return found[0]
    tips = _usual_tips(parents, base, below, moving)
    raise InvalidRobot(
        f"the arm branches below base {base!r}. Choose tip= from: {_listed(tips)}"
        + (f"; any other {noun} that moves against the base will do, too" if tips else "")
    )


def _listed(tips: list[str]) -> str:
    more = f" and {len(tips) - _LISTED} more" if len(tips) > _LISTED else ""
    return (", ".join(tips[:_LISTED]) or "none") + more


def _usual_tips(
    parents: Mapping[str, str | None], base: str, below: Collection[str], moving: Collection[str]
) -> list[str]:
    """Return frames that are common tips: where the tree branches, as at the palm of a hand, and where it ends.

    Only frames with a movable joint between the base and themselves are returned, in the order from the base.
    """
    children = Counter(parent for frame, parent in parents.items() if parent in below)
    depth, moves = {base: 0}, {base: False}
    for frame in below:  # Parents come before their children.
        parent = parents[frame]
        if frame != base and parent is not None:
            depth[frame], moves[frame] = depth[parent] + 1, moves[parent] or frame in moving
    tips = [frame for frame in below if children[frame] != 1 and moves[frame]]
    # Branching links come first: the palm is a more likely tip than a finger.
    return sorted(tips, key=lambda frame: (children[frame] == 0, depth[frame], frame))


def _below(parents: Mapping[str, str | None], base: str) -> list[str]:
    """Return the base and all frames below it, parents before their children."""
    children: dict[str | None, list[str]] = {}
    for frame, parent in parents.items():
        children.setdefault(parent, []).append(frame)
    found = [base]
    for frame in found:  # The list grows during the loop.
        found += children.get(frame, [])
    return found
