"""The best sequence of solutions through layers: fewest breaks first, then the smallest cost (Bellman 1957).

A node is a solution together with a number of full turns for every joint that has room for them. Most pairs of solutions
of consecutive poses are too far apart for any turns. Each pair is therefore compared once, and its turns only if it is
close.
"""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np

from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry, inlined

STRAIGHT, COPIED, ENDLESS = range(3)
"""How a joint turns: without copies by full turns; with copies within its limits; without limits."""

DISTANCE, TIME, SQUARES, GIVEN = range(4)
"""Cost of a step: the weighted distance; the largest weighted motion of a joint; the squared distance; or the given costs
of the nodes."""

ROOM = 1e-9
"""Distance [rad or m] that a solution may be beyond a limit; it is clamped and judged there."""


@inlined
def copies_of(value: float, low: float, high: float, turning: int) -> int:
    """Number of copies of a value by full turns within its limits; values of COPIED joints are in the first turn."""
    if turning == ENDLESS:
        return 1
    if value < low - ROOM or value > high + ROOM:
        return 0
    return 1 + math.floor((high + ROOM - value) / (2.0 * math.pi)) if turning == COPIED else 1


@inlined
def moved_turns(
    digits: Indices, s: int, turns: Indices, room: Indices, b: int, turning: Indices, units: Indices
) -> int:
    """Turns of a node after a step to solution b, as one number; -1 if b has no room for them.

    Args:
        digits: Turns of each joint by their number, (all copies, n).
        s: Number of the turns of the node.
        turns: Full turns that the step subtracts from each joint's value, (n,).
        room: Number of copies of each joint for each solution, (width, n).
        b: The solution.
        turning: See `STRAIGHT`, (n,).
        units: Place value of a turn of each joint, (n,).
    """
    place = 0
    for j in range(len(turns)):
        digit = digits[s, j]
        if turning[j] == COPIED:
            digit -= turns[j]
        if digit < 0 or digit >= room[b, j]:
            return -1
        place += digit * units[j]
    return place


@entry
def viterbi(
    q: Annotated[Array, "k", "width", "n"],
    ahead: Annotated[Array, "k", "width", "n"],
    count: Annotated[Indices, "k"],
    lower: Annotated[Array, "n"],
    upper: Annotated[Array, "n"],
    turning: Annotated[Indices, "n"],
    copies: Annotated[Indices, "n"],
    longest: Annotated[Array, "*", "n"],
    weights: Annotated[Array, "n"],
    mode: int,
    costs: Annotated[Array, "*", "*"],
    refused: Annotated[Flags, "*", "*"],
    forbidden_edges: Annotated[Indices, "*", 3],
    ends: Annotated[Indices, 2],
    path: Annotated[Indices, "k", OUT],
    report: Annotated[Array, "k", OUT],
) -> int:
    """Find the sequence through layers of solutions with the fewest breaks, and among these the cheapest.

    Args:
        q: Solutions of each pose, with COPIED joints in the first turn of their range, (k, width, n).
        ahead: Joint values to which each solution leads at the next pose, (k, width, n); steps are measured from there.
            If solutions are isolated, q itself.
        count: Number of solutions of each pose, (k,).
        lower: Limits, (n,).
        upper: (n,)
        turning: See `STRAIGHT`, (n,).
        copies: Largest number of copies of each joint, (n,).
        longest: Largest motion of each joint from pose to pose, one row for all steps or one each, (1 or k - 1, n).
        weights: Weight of each joint in the cost, (n,).
        mode: See `DISTANCE`.
        costs: Cost of each node, with GIVEN; else empty, (k or 0, width · product of copies).
        refused: True for nodes that are forbidden; or empty.
        forbidden_edges: Steps that are forbidden: pose, node and following node, sorted by pose, (m, 3).
        ends: First and last node, or -1 for any, (2,).
        path: Receives one node per pose: solution · product of copies + turns; -1 if a pose has no node, (k,).
        report: Receives the breaks before each pose, (k,), and in its first entry the total cost.

    Returns:
        The number of breaks.
    """
    poses, width, dof = q.shape
    total, units = 1, np.empty(dof, dtype=np.int64)
    for j in range(dof):
        units[j] = total
        total *= copies[j]
    digits = np.empty((total, dof), dtype=np.int64)
    for s in range(total):
        for j in range(dof):
            digits[s, j] = s // units[j] % copies[j]
    nodes = width * total
    came = np.zeros((poses, nodes), dtype=np.uint8)
    best = np.full(poses, -1, dtype=np.int64)
    room = np.zeros((width, dof), dtype=np.int64)
    fault, fault_before = np.full(nodes, -1, dtype=np.int64), np.full(nodes, -1, dtype=np.int64)
    sums, sums_before = np.zeros(nodes), np.zeros(nodes)
    turns = np.zeros(dof, dtype=np.int64)
    next_barred = 0
    for i in range(poses):
        for node in range(nodes):
            fault[node] = -1
        for b in range(count[i]):
            for j in range(dof):
                # A value at the very end of a range of whole turns has one more copy than there are nodes for.
                room[b, j] = min(copies_of(q[i, b, j], lower[j], upper[j], turning[j]), copies[j])
        before = best[i - 1] if i > 0 else -1
        # Every solution can be reached by a break from the best node before; continuing steps are compared with that.
        for b in range(count[i]):
            for s in range(total):
                inside = True
                for j in range(dof):
                    if digits[s, j] >= room[b, j]:
                        inside = False
                        break
                node = b * total + s
                if not inside or (len(refused) > 0 and refused[i, node]):
                    continue
                if i == 0 and ends[0] >= 0 and node != ends[0]:
                    continue
                if i == poses - 1 and ends[1] >= 0 and node != ends[1]:
                    continue
                fault[node], sums[node], came[i, node] = 0, 0.0, 0
                if before >= 0:
                    fault[node], sums[node] = fault_before[before] + 1, sums_before[before]
                elif i > 0:
                    fault[node] = i
                if mode == GIVEN:
                    sums[node] += costs[i, node]
        while next_barred < len(forbidden_edges) and forbidden_edges[next_barred, 0] < i - 1:
            next_barred += 1
        some_barred = next_barred < len(forbidden_edges) and forbidden_edges[next_barred, 0] == i - 1
        row = min(i - 1, len(longest) - 1) if i > 0 else 0
        for a in range(count[i - 1] if before >= 0 else 0):
            for b in range(count[i]):
                if total == 1 and mode != GIVEN:
                    # No step makes the sum smaller.
                    worse = fault_before[a] > fault[b]
                    if worse or (fault_before[a] == fault[b] and sums_before[a] >= sums[b]):
                        continue
                cost, close, turned = 0.0, True, False
                for j in range(dof):
                    gap = q[i, b, j] - ahead[i - 1, a, j]
                    turns[j] = 0
                    if turning[j] != STRAIGHT:
                        whole = np.rint(gap / (2.0 * math.pi))
                        gap -= 2.0 * math.pi * whole
                        turns[j] = int(whole)
                        turned = turned or (turning[j] == COPIED and turns[j] != 0)
                    close = close and abs(gap) <= longest[row, j]
                    if not close:
                        break
                    gap *= weights[j]
                    cost = max(cost, abs(gap)) if mode == TIME else cost + gap * gap
                if not close:
                    continue
                if mode == DISTANCE:
                    cost = math.sqrt(cost)
                for s in range(total):
                    node = a * total + s
                    if fault_before[node] < 0:
                        continue
                    after = moved_turns(digits, s, turns, room, b, turning, units) if turned else s
                    to = b * total + after
                    if after < 0 or fault[to] < 0:
                        continue
                    sum_there = sums_before[node] + (costs[i, to] if mode == GIVEN else cost)
                    less = fault_before[node] < fault[to]
                    if not (less or (fault_before[node] == fault[to] and sum_there < sums[to])):
                        continue
                    if some_barred:
                        allowed, k = True, next_barred
                        while k < len(forbidden_edges) and forbidden_edges[k, 0] == i - 1:
                            allowed = allowed and not (
                                forbidden_edges[k, 1] == node and forbidden_edges[k, 2] == to
                            )
                            k += 1
                        if not allowed:
                            continue
                    fault[to], sums[to], came[i, to] = fault_before[node], sum_there, 1 + a
        for node in range(nodes):
            if fault[node] < 0:
                continue
            first = best[i] < 0
            if (
                first
                or fault[node] < fault[best[i]]
                or (fault[node] == fault[best[i]] and sums[node] < sums[best[i]])
            ):
                best[i] = node
        for node in range(nodes):
            fault_before[node], sums_before[node] = fault[node], sums[node]
    node, breaks = best[poses - 1], 0
    cost = sums_before[node] if node >= 0 else np.inf
    for back in range(poses):
        i = poses - 1 - back
        path[i], report[i] = node, 0.0
        if i == 0:
            break
        a = int(came[i, node]) - 1 if node >= 0 else -1
        if a < 0:
            report[i] = 1.0
            breaks += 1
            node = best[i - 1]
            continue
        b, s = node // total, node % total
        # The turns before are those of the node plus those that the step subtracted.
        place = a * total + s
        for j in range(dof):
            if turning[j] == COPIED:
                place += units[j] * int(np.rint((q[i, b, j] - ahead[i - 1, a, j]) / (2.0 * math.pi)))
        node = place
    report[0] = cost
    return breaks


STEEPEST, MOST_SHARE = 8, 4.0
"""Exponent, and cap of the share. The share of a step is its largest joint motion divided by the allowed one. The cost
between layers is multiplied by 1 + min(share, MOST_SHARE)^STEEPEST, so steps that are too large are used only if
nothing else continues."""


@entry
def viterbi_step(
    q_before: Annotated[Array, "a", "n"],
    ahead: Annotated[Array, "a", "n"],
    report: Annotated[Array, "a", "*"],
    along_ahead: Annotated[Array, "a", "n"],
    q: Annotated[Array, "b", "n"],
    along: Annotated[Array, "b", "n"],
    lower: Annotated[Array, "n"],
    upper: Annotated[Array, "n"],
    turning: Annotated[Indices, "n"],
    copies: Annotated[Indices, "n"],
    longest: Annotated[Array, "n"],
    sideways: Annotated[Array, "n"],
    weights: Annotated[Array, "n"],
    poses: float,
    own: Annotated[Array, "*"],
    fault_before: Annotated[Indices, "*"],
    sums_before: Annotated[Array, "*"],
    fault: Annotated[Indices, "*", OUT],
    sums: Annotated[Array, "*", OUT],
    came: Annotated[Indices, "*", OUT],
) -> None:
    """Advance by one layer, along branches and sideways from their ends: one step of `viterbi` for redundant arms.

    The sideways motion is spread over all poses between the two layers. If it crosses a singularity to a branch that is
    not connected to this one, it is made in one step and counted so.

    Args:
        q_before: Solutions of the previous layer, (a, n).
        ahead: Ends of their branches, (a, n).
        report: See `propagation.BASE`, (a, 1 + 2 n).
        along_ahead: Directions of the self-motion there, (a, n).
        q: Solutions of this layer, with COPIED joints in the first turn of their range, (b, n).
        along: Directions of the self-motion there, (b, n).
        lower: Limits, (n,).
        upper: (n,)
        turning: See `STRAIGHT`, (n,).
        copies: Largest number of copies of each joint, (n,).
        longest: Largest motion of each joint from pose to pose, (n,).
        sideways: Largest sideways motion of each joint, (n,).
        weights: Weight of each joint in the cost, (n,).
        poses: Number of steps between the layers.
        own: Cost of each node of this layer, (b · product of copies,); or empty.
        fault_before: Number of breaks before each node of the previous layer, -1 for a missing node, (a · product of
            copies,).
        sums_before: Costs up to these nodes.
        fault: Receives the same for this layer, (b · product of copies,).
        sums: Receives its costs.
        came: Receives the predecessor of each node; after a break -2 less that node.
    """
    dof, total = len(lower), 1
    units = np.empty(dof, dtype=np.int64)
    for j in range(dof):
        units[j] = total
        total *= copies[j]
    digits = np.empty((total, dof), dtype=np.int64)
    for s in range(total):
        for j in range(dof):
            digits[s, j] = s // units[j] % copies[j]
    room, turns, gaps = np.zeros((len(q), dof), dtype=np.int64), np.zeros(dof, dtype=np.int64), np.zeros(dof)
    before = -1
    for node in range(len(fault_before)):
        if fault_before[node] >= 0 and (
            before < 0
            or fault_before[node] < fault_before[before]
            or (fault_before[node] == fault_before[before] and sums_before[node] < sums_before[before])
        ):
            before = node
    for b in range(len(q)):
        for j in range(dof):
            room[b, j] = min(copies_of(q[b, j], lower[j], upper[j], turning[j]), copies[j])
        for s in range(total):
            node = b * total + s
            fault[node], sums[node], came[node] = 0, 0.0, -2 - before
            if before >= 0:
                fault[node], sums[node] = fault_before[before] + 1, sums_before[before]
            if len(own) > 0:
                sums[node] += own[node]
            for j in range(dof):
                if digits[s, j] >= room[b, j]:
                    fault[node] = -1
    for a in range(len(q_before)):
        if not report[a, 0] < np.inf:
            continue
        for b in range(len(q)):
            if total == 1:
                worse = fault_before[a] < 0 or fault_before[a] > fault[b]
                if worse or (fault_before[a] == fault[b] and sums_before[a] >= sums[b]):
                    continue
            close, turned = True, False
            for j in range(dof):
                gap = q[b, j] - ahead[a, j]
                turns[j] = 0
                if turning[j] != STRAIGHT:
                    whole = np.rint(gap / (2.0 * math.pi))
                    gap -= 2.0 * math.pi * whole
                    turns[j] = int(whole)
                    turned = turned or (turning[j] == COPIED and turns[j] != 0)
                gaps[j] = gap
                close = abs(gap) <= sideways[j]
                if not close:
                    break
            if not close:
                continue
            cost, share, same = report[a, 0], 0.0, 0.0
            for j in range(dof):
                same += along_ahead[a, j] * along[b, j]
                cost += (
                    weights[j]
                    * weights[j]
                    * (2.0 * (ahead[a, j] - q_before[a, j]) + gaps[j])
                    * gaps[j]
                    / poses
                )
            for j in range(dof):
                gap = gaps[j] / poses if same > 0.0 else gaps[j]
                most = max(abs(report[a, 1 + j] + gap), abs(report[a, 1 + dof + j] + gap))
                share = max(share, most / longest[j])
            cost = max(cost, 0.0) * (1.0 + min(share, MOST_SHARE) ** STEEPEST)
            for s in range(total):
                node = a * total + s
                if fault_before[node] < 0:
                    continue
                after = moved_turns(digits, s, turns, room, b, turning, units) if turned else s
                to = b * total + after
                if after < 0 or fault[to] < 0:
                    continue
                sum_there = sums_before[node] + cost + (own[to] if len(own) > 0 else 0.0)
                if fault_before[node] < fault[to] or (
                    fault_before[node] == fault[to] and sum_there < sums[to]
                ):
                    fault[to], sums[to], came[to] = fault_before[node], sum_there, node
