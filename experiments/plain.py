"""The paper's searches in plain Python: once with node objects as in Sec. 3.1, and twice with bare numbers.

Nothing here is compiled and nothing is NumPy. All three programs visit the same nodes in the same order and
share the forward kinematics; they differ in how a joint value is stored, the question of Sec. 5.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from .arms import spacings

Frame = tuple[float, ...]
"""Twelve numbers: the origin [m] and the x, y and z axes of a frame, each in the base."""
BASE: Frame = (0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Link:
    """One joint: where its frame stands in the one before it, and what it does there."""

    kind: str
    """Turns about ``"rx"``, ``"ry"`` or ``"rz"``, or slides along ``"px"``, ``"pz"`` or, downwards, ``"-pz"``."""
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m]"""
    lower: float = 0.0
    """[rad] or [m]"""
    upper: float = 2 * math.pi
    """[rad] or [m]"""

    @property
    def revolute(self) -> bool:
        """Does it turn?"""
        return self.kind.startswith("r")


@dataclass(frozen=True)
class PlainArm:
    """A chain of links and the place of the tip in the last one."""

    links: tuple[Link, ...]
    tip: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """[m]"""


ARMS = {
    2: PlainArm((Link("rz"), Link("rz", (0.5, 0.0, 0.0))), (0.25, 0.0, 0.0)),
    3: PlainArm(
        (Link("rz"), Link("pz", (0.0, 0.0, 0.0), 0.0, 0.5), Link("px", (0.0, 0.0, 0.0), 0.25, 0.75)),
    ),
    4: PlainArm(
        (
            Link("rz"),
            Link("rz", (0.5, 0.0, 0.0)),
            Link("-pz", (0.25, 0.0, 0.0), 0.0, 0.25),
            Link("rz"),
        )
    ),
    6: PlainArm(
        (
            Link("rz", (0.0, 0.0, 0.25)),
            Link("ry"),
            Link("ry", (0.5, 0.0, 0.0)),
            Link("rx", (0.25, 0.0, 0.0)),
            Link("ry"),
            Link("rx"),
        )
    ),
    7: PlainArm(
        (
            Link("rz", (0.0, 0.0, 0.25)),
            Link("ry"),
            Link("rz", (0.0, 0.0, 0.5)),
            Link("ry"),
            Link("rz", (0.0, 0.0, 0.25)),
            Link("ry"),
            Link("rz"),
        )
    ),
}
"""The paper's four, as the catalogue has them, and one of seven joints whose shoulder and wrist are spherical."""


def moved(frame: Frame, link: Link, value: float) -> Frame:
    """The frame behind a joint, from the one before it and the joint's value [rad] or [m]."""
    px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz = frame
    a, b, c = link.offset
    kind = link.kind
    if kind == "pz":
        c += value
    elif kind == "-pz":
        c -= value
    elif kind == "px":
        a += value
    px += a * xx + b * yx + c * zx
    py += a * xy + b * yy + c * zy
    pz += a * xz + b * yz + c * zz
    if not link.revolute:
        return px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz
    cos, sin = math.cos(value), math.sin(value)
    if kind == "rz":
        xx, yx = cos * xx + sin * yx, cos * yx - sin * xx
        xy, yy = cos * xy + sin * yy, cos * yy - sin * xy
        xz, yz = cos * xz + sin * yz, cos * yz - sin * xz
    elif kind == "ry":
        xx, zx = cos * xx - sin * zx, cos * zx + sin * xx
        xy, zy = cos * xy - sin * zy, cos * zy + sin * xy
        xz, zz = cos * xz - sin * zz, cos * zz + sin * xz
    else:
        yx, zx = cos * yx + sin * zx, cos * zx - sin * yx
        yy, zy = cos * yy + sin * zy, cos * zy - sin * yy
        yz, zz = cos * yz + sin * zz, cos * zz - sin * yz
    return px, py, pz, xx, xy, xz, yx, yy, yz, zx, zy, zz


def pose_of(arm: PlainArm, q: Sequence[float]) -> Frame:
    """Forward kinematics: the frame of the tip."""
    frame = BASE
    for link, value in zip(arm.links, q, strict=True):
        frame = moved(frame, link, value)
    return moved(frame, Link("", arm.tip), 0.0)


def error_of(frame: Frame, goal: Frame) -> float:
    """The paper's error with K_P = K_A = 1 (Sec. 2.2)."""
    px, py, pz, xx, xy, xz, yx, yy, yz = frame[:9]
    gx, gy, gz, gxx, gxy, gxz, gyx, gyy, gyz = goal[:9]
    distance = math.sqrt((px - gx) ** 2 + (py - gy) ** 2 + (pz - gz) ** 2)
    return distance + (1 - xx * gxx - xy * gxy - xz * gxz) + (1 - yx * gyx - yy * gyy - yz * gyz)


@dataclass(frozen=True)
class Grid:
    """B nodes a joint, spread as kinseek spreads them, and the breadths of divide and conquer."""

    arm: PlainArm
    size: int
    """The paper's B."""
    divisions: int
    """The paper's D; with D = B there is one pass, and that is brute force."""
    breadths: tuple[int, ...]
    """The paper's Br, one a joint."""

    def spacings(self) -> list[int]:
        """Of every pass, in nodes."""
        return spacings(self.size, self.divisions)

    def value(self, joint: int, index: int) -> float:
        """Value of a node [rad] or [m]."""
        link = self.arm.links[joint]
        steps = self.size if link.revolute else max(self.size - 1, 1)
        step = (link.upper - link.lower) / steps
        return min(link.lower + step * index, link.upper)

    def indices(self, joint: int, centre: int, spacing: int, first: bool) -> list[int]:
        """Indices of the nodes that a joint tries in a pass."""
        turns = self.arm.links[joint].revolute
        if first:
            count = min(self.divisions, self.size)
            if turns:
                return [i * self.size // count for i in range(count)]
            return [(2 * i + 1) * self.size // (2 * count) for i in range(count)]
        count = min(2 * (self.divisions // 2 + self.breadths[joint]) - 1, self.size)
        count = min(count, (self.size - 1) // spacing + 1)
        low = centre - (count // 2) * spacing
        if turns:
            return [(low + i * spacing) % self.size for i in range(count)]
        while low < 0:
            low += spacing
        while low + (count - 1) * spacing >= self.size and low >= spacing:
            low -= spacing
        return [low + i * spacing for i in range(count) if low + i * spacing < self.size]


class Enough(Exception):
    """Raised where a measurement of memory has seen all that a search holds at once."""


class Node:
    """A value that a joint may take (Sec. 3.1): an ordinary Python object, as there."""

    def __init__(self, joint: int, index: int, value: float, revolute: bool) -> None:
        """Keep what the paper's nodes keep."""
        self.joint = joint
        self.index = index
        self.value = value
        self.revolute = revolute


class ObjectSearch:
    """Algorithms 1 and 2 with node objects, queues and recursion."""

    def __init__(self, grid: Grid, dynamic: bool, most_leaves: int | None = None) -> None:
        """Make the tree, or with the dynamically-created tree (DT) make nothing yet."""
        self.grid, self.dynamic, self.most_leaves = grid, dynamic, most_leaves
        self.created = self.expanded = self.leaves = 0
        self.tree: list[list[Node]] = []
        if not dynamic:
            self.tree = [
                [self.new_node(joint, index) for index in range(grid.size)]
                for joint in range(len(grid.arm.links))
            ]

    def new_node(self, joint: int, index: int) -> Node:
        """Make a node and count it."""
        self.created += 1
        return Node(joint, index, self.grid.value(joint, index), self.grid.arm.links[joint].revolute)

    def solve(self, goal: Frame) -> list[float]:
        """Answer one goal (Algorithm 2)."""
        self.goal = goal
        self.best_error = math.inf
        self.best_assignment: list[Node] = []
        for number, spacing in enumerate(self.grid.spacings()):
            self.spacing, self.first = spacing, number == 0
            self.centre = [node.index for node in self.best_assignment] or [0] * len(self.grid.arm.links)
            self.recursive_depth_search(None, [])
        return [node.value for node in self.best_assignment]

    def initialize_queue(self, joint: int) -> deque[Node]:
        """The nodes that a joint tries in this pass."""
        indices = self.grid.indices(joint, self.centre[joint], self.spacing, self.first)
        if self.dynamic:
            return deque(self.new_node(joint, index) for index in indices)
        return deque(self.tree[joint][index] for index in indices)

    def recursive_depth_search(self, node: Node | None, assignment: list[Node]) -> None:
        """Algorithm 1."""
        joint = -1 if node is None else node.joint
        if joint == len(self.grid.arm.links) - 1:
            self.leaves += 1
            error = error_of(pose_of(self.grid.arm, [one.value for one in assignment]), self.goal)
            if error < self.best_error:
                self.best_error = error
                self.best_assignment = list(assignment)
            if self.leaves == self.most_leaves:
                raise Enough
            return
        queue = self.initialize_queue(joint + 1)
        while queue:
            child = queue.popleft()
            self.expanded += 1
            assignment.append(child)
            self.recursive_depth_search(child, assignment)
            assignment.pop()


class NumberSearch:
    """The same search with bare numbers: an index and a value, no node, no queue.

    With `carry` the frame behind each joint goes down the recursion too, so that a leaf costs one joint's
    forward kinematics instead of the whole arm's.
    """

    def __init__(self, grid: Grid, carry: bool, most_leaves: int | None = None) -> None:
        """Nothing is made beforehand."""
        self.grid, self.carry, self.most_leaves = grid, carry, most_leaves
        self.created = self.expanded = self.leaves = 0

    def solve(self, goal: Frame) -> list[float]:
        """Answer one goal."""
        self.goal = goal
        self.best_error = math.inf
        count = len(self.grid.arm.links)
        best = [0] * count
        for number, spacing in enumerate(self.grid.spacings()):
            self.indices = [self.grid.indices(j, best[j], spacing, number == 0) for j in range(count)]
            self.values = [[self.grid.value(j, i) for i in self.indices[j]] for j in range(count)]
            self.places, self.q = [0] * count, [0.0] * count
            self.best_places: list[int] | None = None
            if self.carry:
                self.descend_carrying(0, BASE)
            else:
                self.descend(0)
            if self.best_places is not None:
                best = [self.indices[j][place] for j, place in enumerate(self.best_places)]
        return [self.grid.value(j, index) for j, index in enumerate(best)]

    def descend(self, joint: int) -> None:
        """Try every value of a joint, and at the last joint look at the error."""
        last = joint == len(self.places) - 1
        for place, value in enumerate(self.values[joint]):
            self.expanded += 1
            self.places[joint] = place
            self.q[joint] = value
            if last:
                self.look(error_of(pose_of(self.grid.arm, self.q), self.goal))
            else:
                self.descend(joint + 1)

    def descend_carrying(self, joint: int, frame: Frame) -> None:
        """As `descend`, with the frame behind the joints so far."""
        link, last = self.grid.arm.links[joint], joint == len(self.places) - 1
        for place, value in enumerate(self.values[joint]):
            self.expanded += 1
            self.places[joint] = place
            behind = moved(frame, link, value)
            if last:
                self.look(error_of(moved(behind, Link("", self.grid.arm.tip), 0.0), self.goal))
            else:
                self.descend_carrying(joint + 1, behind)

    def look(self, error: float) -> None:
        """Keep the best leaf."""
        self.leaves += 1
        if error < self.best_error:
            self.best_error = error
            self.best_places = list(self.places)
        if self.leaves == self.most_leaves:
            raise Enough


PROGRAMS: dict[str, Callable[..., ObjectSearch | NumberSearch]] = {
    "objects": lambda grid, most=None: ObjectSearch(grid, dynamic=False, most_leaves=most),
    "objects, DT": lambda grid, most=None: ObjectSearch(grid, dynamic=True, most_leaves=most),
    "numbers": lambda grid, most=None: NumberSearch(grid, carry=False, most_leaves=most),
    "numbers, frames carried": lambda grid, most=None: NumberSearch(grid, carry=True, most_leaves=most),
}
