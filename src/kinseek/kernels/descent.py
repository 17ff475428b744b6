"""From the middle of a box to an answer nearby, by Gauss-Newton steps inside the limits."""

from __future__ import annotations

from .arrays import Array, ChainArrays
from .atlas import TURN
from .boxes import LEAST, LENGTH, Desk, Form, Wanted, motion, place, turn_goal
from .forms import normal_matrix, solve
from .jit import inner
from .roll import Roll, complete, roll_fits


@inner
def step(form: Form, wanted: Wanted, desk: Desk) -> None:
    """Write the Gauss-Newton step from the middle of the box to the goal into ``desk.delta``."""
    scale = 1.0 / (wanted.scalars[LENGTH] * wanted.scalars[LENGTH] + LEAST)
    weight = 1.0 if form.columns > 0 else 0.0
    T, goal = desk.T, desk.goal
    place(form, desk)
    turn_goal(form, wanted, desk)
    motion(form, desk, 0, len(form.leader), T[0, 3], T[1, 3], T[2, 3])
    normal_matrix(form, desk, scale, weight, form.columns)
    t0 = t1 = t2 = 0.0
    for i in range(form.columns):
        t0 += T[1, i] * goal[2, i] - T[2, i] * goal[1, i]
        t1 += T[2, i] * goal[0, i] - T[0, i] * goal[2, i]
        t2 += T[0, i] * goal[1, i] - T[1, i] * goal[0, i]
    for i in range(len(desk.c)):
        desk.delta[i], desk.D[i] = 0.0, 1e-9
    for k in range(len(form.leader)):
        rhs = 0.0
        for r in range(3):
            rhs += scale * desk.velocity[k, r] * (T[r, 3] - goal[r, 3])
        if not form.prismatic[k]:
            rhs -= weight * (desk.z[k, 0] * t0 + desk.z[k, 1] * t1 + desk.z[k, 2] * t2)
        desk.delta[form.leader[k]] -= form.multiplier[k] * rhs
    solve(desk.N, desk.D, desk.delta)


@inner
def approach(
    form: Form, wanted: Wanted, roll: Roll, chain: ChainArrays, steps: int, desk: Desk, q: Array
) -> None:
    """Gauss-Newton steps from the middle of the box; the joint values they lead to, (n,), inside the limits."""
    for _ in range(steps):
        step(form, wanted, desk)
        for i in range(len(desk.c)):
            desk.c[i] += desk.delta[i]
            if i > 0 or form.head != TURN:
                desk.c[i] = min(max(desk.c[i], chain.lower[i]), chain.upper[i])
    place(form, desk)
    turn_goal(form, wanted, desk)
    if roll.present:
        roll_fits(form, wanted, roll, desk)
    complete(form, roll, chain, desk, q)
