"""The gate of a proof for many poses: which of them lengths and angles alone exclude."""

from __future__ import annotations

from typing import Annotated

from kinseek.kernels.arrays import Array, ChainArrays
from kinseek.kernels.entry import OUT
from kinseek.kernels.jit import entry
from kinseek.kernels.proof.box import Form, ProofGoal
from kinseek.kernels.proof.gate import gate


@entry
def many_gates(
    form: Form,
    proof_goal: ProofGoal,
    chain: ChainArrays,
    before: Annotated[Array, 3, 4],
    after: Annotated[Array, 3, 4],
    targets: Annotated[Array, "k", 3, 4],
    target: Annotated[Array, 3, 4, OUT],
    closed: Annotated[Array, "k", OUT],
) -> int:
    """Apply the gate to many poses and count those that it excludes.

    Args:
        form: The question, see `kinseek.proof.reduce.question`.
        proof_goal: Its tolerances, with margins that are valid for the farthest pose; its `target` is the memory of
            `target`.
        chain: The arm.
        before: Transform that multiplies a pose from the left, (3, 4).
        after: Transform that multiplies a pose from the right, (3, 4).
        targets: Poses, (k, 3, 4), lengths in [m].
        target: Scratch memory, (3, 4).
        closed: Receives 1 if a pose is excluded, else 0, (k,).

    Returns:
        The number of excluded poses.
    """
    count = 0
    for i in range(targets.shape[0]):
        for r in range(3):
            x, y, z, p = 0.0, 0.0, 0.0, before[r, 3]
            for c in range(3):
                x += before[r, c] * targets[i, c, 0]
                y += before[r, c] * targets[i, c, 1]
                z += before[r, c] * targets[i, c, 2]
                p += before[r, c] * targets[i, c, 3]
            for c in range(3):
                target[r, c] = x * after[0, c] + y * after[1, c] + z * after[2, c]
            target[r, 3] = x * after[0, 3] + y * after[1, 3] + z * after[2, 3] + p
        passes, _ = gate(form, proof_goal, chain)
        closed[i] = 0.0 if passes else 1.0
        count += 0 if passes else 1
    return count
