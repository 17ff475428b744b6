"""The best sequence of solutions through layers: fewest breaks first, then the smallest cost.

Let W(b) be the breaks and the cost of the best way to node b, in lexicographic order. With the nodes a of the layer before
(Bellman 1957, Viterbi 1967),

    W(b) = min(min over a of W(a) + (0, cost of the step), min over a of W(a) + (1, 0)),

where only steps within the longest motions count, and the second minimum is a break. A node is a solution together with a
number of full turns for every joint that has room for them. Most pairs of solutions of consecutive poses are too far apart
for any turns. Each pair is therefore compared once, and its turns only if it is close.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import counted, entry, inlined

STRAIGHT, COPIED, ENDLESS = 0, 1, 2
"""How a joint turns: without copies by full turns; with copies within its limits; without limits."""

DISTANCE, TIME, SQUARES, GIVEN = 0, 1, 2, 3
"""Cost of a step: the weighted distance; the largest weighted motion of a joint; the squared distance; or the given costs
of the nodes."""

ROOM = 1e-9
"""Distance [rad or m] that a solution may be beyond a limit; it is clamped and judged there."""

STEEPEST, MOST_SHARE = 8, 4.0
"""Exponent, and cap of the share. The share of a step is its largest joint motion divided by the allowed one. The cost
between layers is multiplied by 1 + min(share, MOST_SHARE)^STEEPEST, so steps that are too large are used only if
nothing else continues."""


class Turns(NamedTuple):
    """How the joints turn within their limits."""

    lower: Annotated[Array, "n"]
    """Limits, (n,), [rad] or [m]."""
    upper: Annotated[Array, "n"]
    kind: Annotated[Indices, "n"]
    """See `STRAIGHT`, (n,)."""
    copies: Annotated[Indices, "n"]
    """Largest number of copies of each joint, (n,)."""


class Layers(NamedTuple):
    """Solutions of consecutive poses."""

    q: Annotated[Array, "k", "width", "n"]
    """Solutions of each pose, with COPIED joints in the first turn of their range, (k, width, n)."""
    counts: Annotated[Indices, "k"]
    """Number of solutions of each pose, (k,)."""


class Steps(NamedTuple):
    """How far steps lead, and what they cost."""

    longest: Annotated[Array, "*", "n"]
    """Largest motion of each joint from pose to pose, one row for all steps or one each, (1 or k - 1, n)."""
    weights: Annotated[Array, "n"]
    """Weight of each joint in the cost, (n,)."""
    mode: int
    """See `DISTANCE`."""


class Rules(NamedTuple):
    """Costs of nodes, and nodes and steps that are forbidden."""

    costs: Annotated[Array, "*", "*"]
    """Cost of each node, with GIVEN; else empty, (k or 0, width · product of copies)."""
    refused: Annotated[Flags, "*", "*"]
    """True for nodes that are forbidden; or empty."""
    forbidden_edges: Annotated[Indices, "*", 3]
    """Steps that are forbidden: pose, node and following node, sorted by pose, (m, 3)."""
    ends: Annotated[Indices, 2]
    """First and last node, or -1 for any, (2,)."""


class Nodes(NamedTuple):
    """The nodes of a layer. The number of one is its solution times the number of all turns, plus that of its turns."""

    joints: Turns
    digits: Indices
    """Turns of each joint by their number, (all turns, n)."""
    units: Indices
    """Place value of a turn of each joint, (n,)."""
    room: Indices
    """Number of copies of each joint for each solution, (width, n)."""
    turns: Indices
    """Full turns that the present step subtracts from each COPIED joint, (n,)."""


@counted
def nodes_of(turns: Turns, width: int) -> Nodes:
    """Number the turns of all joints, for layers of `width` solutions."""
    dof, total = len(turns.copies), 1
    units = np.empty(dof, dtype=np.int64)
    for j in range(dof):
        units[j] = total
        total *= turns.copies[j]
    digits = np.empty((total, dof), dtype=np.int64)
    for s in range(total):
        for j in range(dof):
            digits[s, j] = s // units[j] % turns.copies[j]
    return Nodes(turns, digits, units, np.zeros((width, dof), dtype=np.int64), np.zeros(dof, dtype=np.int64))


@inlined
def count_copies(nodes: Nodes, b: int, q: Array) -> None:
    """Write the room of solution b, (n,): the numbers of copies of its values by full turns within the limits."""
    turns = nodes.joints
    for j in range(len(q)):
        value, low, high = q[j], turns.lower[j] - ROOM, turns.upper[j] + ROOM
        copies = 1
        if turns.kind[j] != ENDLESS and (value < low or value > high):
            copies = 0
        elif turns.kind[j] == COPIED:
            copies = 1 + math.floor((high - value) / (2.0 * math.pi))
        # A value at the very end of a range of whole turns has one more copy than there are nodes for.
        nodes.room[b, j] = min(copies, turns.copies[j])


@inlined
def has_room(nodes: Nodes, b: int, s: int) -> bool:
    """Return True if solution b has copies with the turns of number s."""
    for j in range(len(nodes.units)):  # noqa: SIM110 (kernels have no generators)
        if nodes.digits[s, j] >= nodes.room[b, j]:
            return False
    return True


@inlined
def short_way(nodes: Nodes, j: int, gap: float) -> float:
    """Reduce the difference of two values of a joint by full turns where these make no difference; store the turns."""
    kind = nodes.joints.kind[j]
    nodes.turns[j] = 0
    if kind != STRAIGHT:
        whole = np.rint(gap / (2.0 * math.pi))
        gap -= 2.0 * math.pi * whole
        nodes.turns[j] = int(whole) if kind == COPIED else 0
    return gap


@inlined
def node_after(nodes: Nodes, s: int, b: int, turned: bool) -> int:
    """Node of solution b after a step from a node with turns of number s; -1 if b has no room for its turns."""
    if not turned:
        return b * len(nodes.digits) + s
    place = b * len(nodes.digits)
    for j in range(len(nodes.units)):
        digit = nodes.digits[s, j] - nodes.turns[j]
        if digit < 0 or digit >= nodes.room[b, j]:
            return -1
        place += digit * nodes.units[j]
    return place


@inlined
def is_better(fault: int, cost: float, than_fault: int, than_cost: float) -> bool:
    """Return True if a way has fewer breaks than another one, or as many and a smaller cost."""
    return fault < than_fault or (fault == than_fault and cost < than_cost)


@inlined
def best_of(fault: Indices, sums: Array) -> int:
    """Node with the best way to it; -1 if there is no node."""
    best = -1
    for node in range(len(fault)):
        if fault[node] >= 0 and (best < 0 or is_better(fault[node], sums[node], fault[best], sums[best])):
            best = node
    return best


@inlined
def measure(layers: Layers, steps: Steps, nodes: Nodes, i: int, a: int, b: int) -> tuple[bool, bool, float]:
    """Compare solution b of pose i with solution a before it: whether it is close, with full turns, and the cost."""
    cost, turned, row = 0.0, False, min(i - 1, len(steps.longest) - 1)
    for j in range(len(steps.weights)):
        gap = short_way(nodes, j, layers.q[i, b, j] - layers.q[i - 1, a, j])
        if not abs(gap) <= steps.longest[row, j]:
            return False, False, 0.0
        turned = turned or nodes.turns[j] != 0
        gap *= steps.weights[j]
        cost = max(cost, abs(gap)) if steps.mode == TIME else cost + gap * gap
    return True, turned, math.sqrt(cost) if steps.mode == DISTANCE else cost


@inlined
def is_refused(rules: Rules, i: int, poses: int, node: int) -> bool:
    """Return True if a node of pose i is forbidden, or not the required one at an end of the path."""
    first, last = rules.ends[0], rules.ends[1]
    if (i == 0 and first >= 0 and node != first) or (i == poses - 1 and last >= 0 and node != last):
        return True
    return len(rules.refused) > 0 and rules.refused[i, node]


@inlined
def is_forbidden(edges: Indices, first: int, node: int, to: int) -> bool:
    """Return True if a step is among the forbidden ones of the pose of edge `first`."""
    k = first
    while k < len(edges) and edges[k, 0] == edges[first, 0]:
        if edges[k, 1] == node and edges[k, 2] == to:
            return True
        k += 1
    return False


@entry
def viterbi(
    layers: Layers,
    turns: Turns,
    steps: Steps,
    rules: Rules,
    path: Annotated[Indices, "k", OUT],
    report: Annotated[Array, "k", OUT],
) -> int:
    """Find the sequence through layers of solutions with the fewest breaks, and among these the cheapest.

    Args:
        layers: The solutions.
        turns: How the joints turn.
        steps: How far steps lead, and what they cost.
        rules: Costs of nodes, and what is forbidden.
        path: Receives one node per pose, see `Nodes`; -1 if a pose has no node, (k,).
        report: Receives the breaks before each pose, (k,), and in its first entry the total cost.

    Returns:
        The number of breaks.
    """
    poses, width, dof = layers.q.shape
    nodes, edges, given = nodes_of(turns, width), rules.forbidden_edges, steps.mode == GIVEN
    total = len(nodes.digits)
    came, best = np.zeros((poses, width * total), dtype=np.uint16), np.full(poses, -1, dtype=np.int64)
    fault, fault_before = np.full(width * total, -1, np.int64), np.full(width * total, -1, np.int64)
    sums, sums_before, first_edge = np.zeros(width * total), np.zeros(width * total), 0
    for i in range(poses):
        before = best[i - 1] if i > 0 else -1
        fault[:] = -1
        # Every solution can be reached by a break from the best node before; continuing steps are compared with that.
        for b in range(layers.counts[i]):
            count_copies(nodes, b, layers.q[i, b])
            for s in range(total):
                node = b * total + s
                if not has_room(nodes, b, s) or is_refused(rules, i, poses, node):
                    continue
                fault[node], sums[node] = i, 0.0
                if before >= 0:
                    fault[node], sums[node] = fault_before[before] + 1, sums_before[before]
                if given:
                    sums[node] += rules.costs[i, node]
        while first_edge < len(edges) and edges[first_edge, 0] < i - 1:
            first_edge += 1
        some_forbidden = first_edge < len(edges) and edges[first_edge, 0] == i - 1
        for a in range(layers.counts[i - 1] if before >= 0 else 0):
            for b in range(layers.counts[i]):
                # No step makes the sum smaller.
                if (
                    total == 1
                    and not given
                    and not is_better(fault_before[a], sums_before[a], fault[b], sums[b])
                ):
                    continue
                close, turned, cost = measure(layers, steps, nodes, i, a, b)
                for s in range(total if close else 0):
                    node = a * total + s
                    if fault_before[node] < 0:
                        continue
                    to = node_after(nodes, s, b, turned)
                    if to < 0 or fault[to] < 0:
                        continue
                    sum_there = sums_before[node] + (rules.costs[i, to] if given else cost)
                    if not is_better(fault_before[node], sum_there, fault[to], sums[to]):
                        continue
                    if some_forbidden and is_forbidden(edges, first_edge, node, to):
                        continue
                    fault[to], sums[to], came[i, to] = fault_before[node], sum_there, 1 + a
        best[i] = best_of(fault, sums)
        for node in range(len(fault)):
            fault_before[node], sums_before[node] = fault[node], sums[node]
    node, breaks = best[poses - 1], 0
    cost = sums_before[node] if node >= 0 else np.inf
    for i in range(poses - 1, 0, -1):
        path[i], report[i] = node, 0.0
        a = int(came[i, node]) - 1 if node >= 0 else -1
        if a < 0:
            report[i] = 1.0
            breaks += 1
            node = best[i - 1]
            continue
        b = node // total
        # The turns before are those of the node plus those that the step subtracted.
        node += (a - b) * total
        for j in range(dof):
            short_way(nodes, j, layers.q[i, b, j] - layers.q[i - 1, a, j])
            node += nodes.units[j] * nodes.turns[j]
    path[0], report[0] = node, cost
    return breaks


class Layer(NamedTuple):
    """Solutions of a redundant arm at one layer, and the best way to each of its nodes."""

    q: Annotated[Array, "*", "n"]
    """Solutions, with COPIED joints in the first turn of their range, (k, n)."""
    along: Annotated[Array, "*", "n"]
    """Directions of the self-motion there, (k, n)."""
    fault: Annotated[Indices, "*", OUT]
    """Number of breaks before each node, -1 for a missing node, (k · product of copies,)."""
    sums: Annotated[Array, "*", OUT]
    """Costs up to these nodes."""
    came: Annotated[Indices, "*", OUT]
    """The predecessor of each node; after a break -2 less that node."""


class BranchEnds(NamedTuple):
    """Where branches from the solutions of a layer lead at the next one."""

    q: Annotated[Array, "k", "n", OUT]
    """Joint values there, (k, n)."""
    along: Annotated[Array, "k", "n", OUT]
    """Directions of the self-motion there, (k, n), see `propagation.write_self_motions`."""
    cost: Annotated[Array, "k", OUT]
    """Sum of the squared steps; infinite if the branch ends before, (k,)."""
    least: Annotated[Array, "k", "n", OUT]
    """The smallest motion of each joint from pose to pose, (k, n)."""
    most: Annotated[Array, "k", "n", OUT]
    """The largest one."""


class Sideways(NamedTuple):
    """How far a step between layers may lead, and what it costs."""

    longest: Annotated[Array, "n"]
    """Largest motion of each joint from pose to pose, (n,)."""
    sideways: Annotated[Array, "n"]
    """Largest sideways motion of each joint, (n,)."""
    weights: Annotated[Array, "n"]
    """Weight of each joint in the cost, (n,)."""
    poses: float
    """Number of steps between the layers."""


@inlined
def sideways_cost(
    before: Layer, ends: BranchEnds, steps: Sideways, a: int, gaps: Array, same: float
) -> float:
    """Cost of a branch from solution a and of sideways motion by `gaps`, (n,), at its end.

    With the motion of a branch p and the gaps g spread over m poses the squared steps increase by ``(2 p + g)·g / m``. A
    positive `same` says that both solutions are on one curve, which makes the spread possible.
    """
    cost, share = ends.cost[a], 0.0
    for j in range(len(gaps)):
        moved, weight = 2.0 * (ends.q[a, j] - before.q[a, j]) + gaps[j], steps.weights[j]
        cost += weight * weight * moved * gaps[j] / steps.poses
        gap = gaps[j] / steps.poses if same > 0.0 else gaps[j]
        share = max(share, max(abs(ends.least[a, j] + gap), abs(ends.most[a, j] + gap)) / steps.longest[j])
    total: float = max(cost, 0.0) * (1.0 + min(share, MOST_SHARE) ** STEEPEST)
    return total


@entry
def viterbi_step(
    before: Layer,
    ends: BranchEnds,
    here: Layer,
    turns: Turns,
    steps: Sideways,
    own: Annotated[Array, "*"],
) -> None:
    """Advance by one layer, along branches and sideways from their ends: one step of `viterbi` for redundant arms.

    The sideways motion is spread over all poses between the two layers. If it crosses a singularity to a branch that is
    not connected to this one, it is made in one step and counted so.

    Args:
        before: The previous layer; without solutions at the first layer.
        ends: Where the branches from its solutions lead at this layer.
        here: This layer; receives the best ways to its nodes.
        turns: How the joints turn.
        steps: How far steps lead, and what they cost.
        own: Cost of each node of this layer, (k · product of copies,); or empty.
    """
    nodes, gaps, best = (
        nodes_of(turns, len(here.q)),
        np.zeros(len(turns.lower)),
        best_of(before.fault, before.sums),
    )
    total, fault, sums = len(nodes.digits), here.fault, here.sums
    for b in range(len(here.q)):
        count_copies(nodes, b, here.q[b])
        for s in range(total):
            node = b * total + s
            fault[node], sums[node], here.came[node] = 0, 0.0, -2 - best
            if best >= 0:
                fault[node], sums[node] = before.fault[best] + 1, before.sums[best]
            if len(own) > 0:
                sums[node] += own[node]
            if not has_room(nodes, b, s):
                fault[node] = -1
    for a in range(len(before.q)):
        if not ends.cost[a] < np.inf:
            continue
        for b in range(len(here.q)):
            if total == 1 and not is_better(before.fault[a], before.sums[a], fault[b], sums[b]):
                continue
            close, turned, same = True, False, 0.0
            for j in range(len(gaps)):
                gaps[j] = short_way(nodes, j, here.q[b, j] - ends.q[a, j])
                turned = turned or nodes.turns[j] != 0
                same += ends.along[a, j] * here.along[b, j]
                close = abs(gaps[j]) <= steps.sideways[j]
                if not close:
                    break
            cost = sideways_cost(before, ends, steps, a, gaps, same) if close else np.inf
            for s in range(total if close else 0):
                node, to = a * total + s, node_after(nodes, s, b, turned)
                if before.fault[node] < 0 or to < 0 or fault[to] < 0:
                    continue
                sum_there = before.sums[node] + cost + (own[to] if len(own) > 0 else 0.0)
                if is_better(before.fault[node], sum_there, fault[to], sums[to]):
                    fault[to], sums[to], here.came[to] = before.fault[node], sum_there, node
