"""Read SRDF files, in which MoveIt describes how a robot is used: groups, their states, and pairs that never collide.

The elements are those of srdfdom (`srdf::Model`). End effectors and passive joints are not read.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from kinseek.errors import InvalidRobot

from .adapters import is_text
from .files import MOST_LINKS, home_path, require_few
from .xacro import urdf_text
from .xml_files import root_element


class Group(NamedTuple):
    """One ``<group>``: the names in it."""

    chains: tuple[tuple[str, str], ...]
    """Base link and tip link of each chain."""
    joints: tuple[str, ...]
    links: tuple[str, ...]
    """Links; each stands for the joint that moves it."""
    groups: tuple[str, ...]


class State(NamedTuple):
    """One ``<group_state>``."""

    name: str
    group: str
    values: tuple[tuple[str, str], ...]
    """Joints and their values, as written."""


class Pair(NamedTuple):
    """Two links, and why they are checked for collision or not."""

    a: str
    b: str
    reason: str


class VirtualJoint(NamedTuple):
    """One ``<virtual_joint>``: how the robot moves, or stands, in a frame that its URDF does not have."""

    kind: str
    """Type, in lower case: fixed, planar or floating."""
    parent: str
    """The frame."""
    child: str
    """The root link of the robot."""


@dataclass(frozen=True)
class Srdf:
    """The content of an SRDF."""

    where: str
    """The file, for messages."""
    robot: str
    """Name of the robot; empty if the file has none."""
    groups: Mapping[str, Group] = field(repr=False)
    """Groups by name."""
    states: tuple[State, ...] = field(repr=False)
    virtual: Mapping[str, VirtualJoint] = field(repr=False)
    """Virtual joints by name."""
    disabled: tuple[Pair, ...] = field(repr=False)
    unchecked: tuple[str, ...] = field(repr=False)
    """Links that are checked against no other link, except in pairs that are enabled."""
    enabled: tuple[Pair, ...] = field(repr=False)
    """Pairs that are checked in spite of `unchecked`, unless they are disabled too."""


def read_srdf(
    source: str | Path | bytes, packages: Mapping[str, str | Path] | None = None, trusted: bool = True
) -> Srdf:
    """Read an SRDF.

    Args:
        source: The path of a ``.srdf`` or ``.xacro`` file, or the text of an SRDF.
        packages: Folders of ROS packages for a xacro file, by name.
        trusted: Whether Python may evaluate the expressions of a xacro file.

    Raises:
        InvalidRobot: It cannot be read, or is not an SRDF.
    """
    if is_text(source):
        where, text = "the SRDF text", source.encode() if isinstance(source, str) else bytes(source)
    elif isinstance(source, str | Path):
        where, text = str(source), urdf_text(home_path(source), None, packages, trusted)
    else:
        raise InvalidRobot(f"srdf must be the path of an SRDF file, or its text, got {source!r:.80}")
    root = root_element(text, where)
    if root.tag != "robot":
        raise InvalidRobot(f"{where}: not an SRDF: the root tag is <{root.tag}>, expected <robot>")
    for noun in ("group", "group_state", "virtual_joint"):
        require_few(sum(1 for _ in root.iterchildren(noun)), f"<{noun}> elements", MOST_LINKS, where)
    groups = Counter(_get(element, "name") for element in root.iterchildren("group"))
    if twice := next((name for name, count in groups.items() if count > 1), None):
        raise InvalidRobot(f"{where}: two groups are called {twice!r:.100}, expected different names")
    return Srdf(
        where,
        _get(root, "name"),
        {_get(element, "name"): _group(element) for element in root.iterchildren("group")},
        tuple(_state(element) for element in root.iterchildren("group_state")),
        {
            _get(element, "name"): VirtualJoint(
                _get(element, "type").lower(), _get(element, "parent_frame"), _get(element, "child_link")
            )
            for element in root.iterchildren("virtual_joint")
        },
        _pairs(root, "disable_collisions"),
        tuple(_get(element, "link") for element in root.iterchildren("disable_default_collisions")),
        _pairs(root, "enable_collisions"),
    )


def _group(element: Any) -> Group:
    joints, links, groups = (
        tuple(_get(child, "name") for child in element.iterchildren(tag))
        for tag in ("joint", "link", "group")
    )
    chains = tuple(
        (_get(child, "base_link"), _get(child, "tip_link")) for child in element.iterchildren("chain")
    )
    return Group(chains, joints, links, groups)


def _state(element: Any) -> State:
    values = tuple((_get(joint, "name"), _get(joint, "value")) for joint in element.iterchildren("joint"))
    return State(_get(element, "name"), _get(element, "group"), values)


def _pairs(root: Any, tag: str) -> tuple[Pair, ...]:
    return tuple(
        Pair(_get(element, "link1"), _get(element, "link2"), _get(element, "reason"))
        for element in root.iterchildren(tag)
    )


def _get(element: Any, name: str) -> str:
    """Return an attribute without space around it; empty if it is missing."""
    return str(element.get(name) or "").strip()
