"""The best way through layers of answers: fewest breaks first, then the least cost (Bellman 1957).

A node is an answer with a number of full turns of every joint that has room for them. From one pose to the next most pairs
of answers are too far apart whatever the turns, so pairs are looked at once, and their turns only where they are close.
"""

from __future__ import annotations

import math

import numpy as np

from kinseek.kernels.arrays import Array, Flags, Indices
from kinseek.kernels.entry import F64, FLAG, I64
from kinseek.kernels.jit import entry, hidden

STRAIGHT, COPIED, ENDLESS = range(3)
"""How a joint turns: no full turn is free; it has copies inside its limits; it has no limits."""

DISTANCE, TIME, SQUARES, GIVEN = range(4)
"""What a step costs: the weighted distance, the slowest joint's weighted way, the squared distance; or what each node
costs by itself."""

ROOM = 1e-9
"""By so much [rad or m] an answer may stand beyond a limit: it is brought back, and judged there."""


@hidden
def copies_of(value: float, low: float, high: float, turning: int) -> int:
    """How many full turns, from none on, leave a value inside its limits; values of COPIED joints begin at the lower one."""
    if turning == ENDLESS:
        return 1
    if value < low - ROOM or value > high + ROOM:
        return 0
    return 1 + math.floor((high + ROOM - value) / (2.0 * math.pi)) if turning == COPIED else 1


@hidden
def moved_turns(
    digits: Indices, s: int, turns: Indices, room: Indices, b: int, turning: Indices, units: Indices
) -> int:
    """What the turns of a node become by a step to answer b, as one number; -1 where b has no room for them.

    Args:
        digits: Turns of each joint by their number, (copies in all, n).
        s: Those of the node.
        turns: Full turns that the step takes off each joint's value, (n,).
        room: Copies that each answer has of each joint, (width, n).
        b: The answer.
        turning: See `STRAIGHT`, (n,).
        units: What a turn of each joint counts, (n,).
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


@entry(
    returns=I64,
    q=F64["k", "width", "n"],
    ahead=F64["k", "width", "n"],
    count=I64["k"],
    lower=F64["n"],
    upper=F64["n"],
    turning=I64["n"],
    copies=I64["n"],
    longest=F64["*", "n"],
    weights=F64["n"],
    mode=I64,
    costs=F64["*", "*"],
    refused=FLAG["*", "*"],
    barred=I64["*", 3],
    ends=I64[2],
    path=I64["k"].out,
    told=F64["k"].out,
)
def best_way(
    q: Array,
    ahead: Array,
    count: Indices,
    lower: Array,
    upper: Array,
    turning: Indices,
    copies: Indices,
    longest: Array,
    weights: Array,
    mode: int,
    costs: Array,
    refused: Flags,
    barred: Indices,
    ends: Indices,
    path: Indices,
    told: Array,
) -> int:
    """Find the way through layers of answers that breaks least often, and of those ways the cheapest.

    Args:
        q: Answers to each pose, those of COPIED joints in the first turn of their range, (k, width, n).
        ahead: Where each answer leads by itself at the next pose, (k, width, n): steps are counted from there. Where answers
            are isolated, q itself.
        count: How many there are, (k,).
        lower: Limits, (n,).
        upper: (n,)
        turning: See `STRAIGHT`, (n,).
        copies: Copies at most of each joint, (n,).
        longest: How far each joint may go from pose to pose, one row for all steps or one each, (1 or k - 1, n).
        weights: Of each joint in the cost, (n,).
        mode: See `DISTANCE`.
        costs: Of each node, with GIVEN; else empty, (k or 0, width · product of copies).
        refused: Nodes that may not be used; or empty.
        barred: Steps that may not be used: pose, node and following node, sorted by pose, (m, 3).
        ends: First and last node, or -1 where any will do, (2,).
        path: Receives a node a pose: answer · product of copies + turns; -1 where a pose has no node, (k,).
        told: Receives the breaks before each pose, (k,), and in its first place the cost of all.

    Returns:
        How many breaks.
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
        # Any answer can be reached by a break from the best node before; the way on from there is compared with it.
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
        while next_barred < len(barred) and barred[next_barred, 0] < i - 1:
            next_barred += 1
        some_barred = next_barred < len(barred) and barred[next_barred, 0] == i - 1
        row = min(i - 1, len(longest) - 1) if i > 0 else 0
        for a in range(count[i - 1] if before >= 0 else 0):
            for b in range(count[i]):
                if total == 1 and mode != GIVEN:
                    # No step makes the sum less.
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
                        while k < len(barred) and barred[k, 0] == i - 1:
                            allowed = allowed and not (barred[k, 1] == node and barred[k, 2] == to)
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
        path[i], told[i] = node, 0.0
        if i == 0:
            break
        a = int(came[i, node]) - 1 if node >= 0 else -1
        if a < 0:
            told[i] = 1.0
            breaks += 1
            node = best[i - 1]
            continue
        b, s = node // total, node % total
        # The turns before are those of the node, with what the step took off put back.
        place = a * total + s
        for j in range(dof):
            if turning[j] == COPIED:
                place += units[j] * int(np.rint((q[i, b, j] - ahead[i - 1, a, j]) / (2.0 * math.pi)))
        node = place
    told[0] = cost
    return breaks
