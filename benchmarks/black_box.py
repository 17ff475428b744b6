"""Black-box kinematics: share of reachable targets solved, time of a call, and number of poses that the function computes.

Every arm of the list is wrapped by `Arm.from_fk` as a function: vectorised NumPy, the same function one row at a time, and
a Numba function one row at a time. A continuum robot and a five-bar linkage come from the examples. Targets are poses of
joint values uniform inside the limits, and near singularities and limits. A target is solved if plain NumPy forward
kinematics confirms the result within 1e-6 m and 1e-6 rad, and every joint is inside its limits. Times are those of single
calls `arm.ik(T)` from Python. *Poses computed* is the median number of poses that the function computes for a target.

    python -m benchmarks.black_box                 # writes benchmarks/black_box.md
    python -m benchmarks.black_box ur5e --random 200 --output /dev/stdout
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numba
import numpy as np

import kinseek
from kinseek.robots.chain import SerialChain
from kinseek.solvers.black_box.samples import Samples

from .command import ROOT, command
from .page import Flags, Page, Row, list_misses, share
from .targets import Array, plain_fk, pose_errors, random_joints, singular_joints
from .timing import timed

ARMS = ("ur5e", "puma560", "jaco2_6", "irb120", "piper", "panda", "iiwa14", "ur10e_rail", "so101", "irb5400")

WANTED_MS, WANTED_SOLVED = 50.0, 99.9
"""Of six joints as a vectorised function: median of one pose [ms], percent of random targets."""


@dataclass(frozen=True)
class Case:
    """A mechanism, and the way its function is written."""

    name: str
    way: str
    arm: kinseek.Arm
    fk: Callable[[Array], Array]
    """Judges the answers, (k, n) -> (k, 4, 4)."""
    random: Array
    """Joint values of random targets, (k, n)."""
    singular: Array
    """The same near singularities and limits; may be empty."""


def compiled(chain: SerialChain) -> Callable[[Array], Array]:
    """Forward kinematics of one row as a user of Numba writes it, (n,) -> (4, 4)."""
    fixed, slides, leader = chain.fixed, chain.prismatic, chain.leader
    multiplier, offset = chain.multiplier, chain.offset

    @numba.njit
    def fk(q: Array) -> Array:
        T = np.eye(4)
        A, J = np.eye(4), np.eye(4)
        for k in range(len(slides) + 1):
            A[:3] = fixed[k]
            T = T @ A
            if k < len(slides):
                value = multiplier[k] * q[leader[k]] + offset[k]
                J[:] = np.eye(4)
                if slides[k]:
                    J[2, 3] = value
                else:
                    c, s = np.cos(value), np.sin(value)
                    J[0, 0], J[0, 1], J[1, 0], J[1, 1] = c, -s, s, c
                T = T @ J
        return T

    return cast("Callable[[Array], Array]", fk)


def one_row(chain: SerialChain, q: Array) -> Array:
    """Forward kinematics of one row in NumPy, (n,) -> (4, 4)."""
    return np.asarray(plain_fk(chain, q[None])[0])


def catalog_case(name: str, way: str, random: int, singular: int, seed: int) -> Case:
    """A bundled arm as a function that takes many rows, one row, or one row compiled."""
    chain = kinseek.load(name).chain
    functions: dict[str, Callable[..., Any]] = {
        "vectorised": partial(plain_fk, chain),
        "one row": partial(one_row, chain),
        "Numba, one row": compiled(chain),
    }
    arm = kinseek.Arm.from_fk(
        functions[way], chain.lower, chain.upper, way == "vectorised", kinds=chain.kinds, name=name
    )
    return Case(
        name,
        way,
        arm,
        partial(plain_fk, chain),
        random_joints(chain, random, seed),
        singular_joints(chain, singular, seed),
    )


def example_case(example: str, variable: str, random: int, seed: int) -> Case:
    """A mechanism of an example: joint values where it can be put together."""
    names = _definitions(ROOT / "examples" / f"{example}.py")
    arm = names[variable]
    q = np.random.default_rng(seed).uniform(arm.lower, arm.upper, (4 * random, arm.dof))
    q = q[~np.isnan(arm.fk(q)).any(axis=(1, 2))][:random]
    return Case(example, "vectorised", arm, names["fk"], q, q[:0])


def _definitions(example: Path) -> dict[str, Any]:
    """Run an example down to where its mechanism is made."""
    text = example.read_text(encoding="utf-8")
    head = text[: text.index("\nprint(")]
    names: dict[str, Any] = {}
    exec(compile(head, str(example), "exec"), names)
    return names


def good(case: Case, q: Array, targets: Array) -> Flags:
    """Which answers, (k, n), are strict by plain forward kinematics?"""
    away, angle = pose_errors(case.fk(q), targets)
    inside = ((q >= case.arm.lower) & (q <= case.arm.upper)).all(axis=1)
    return np.asarray(inside & (away <= 1e-6) & (angle <= 1e-6))


def measure(case: Case, figures: list[tuple[str, int, float, float]], misses: list[str]) -> Row:
    """Solve every target by a call of its own; add the median time [ms] and the share solved [%] to the figures."""
    case.arm.ik(case.fk(case.random[:1])[0])  # Whatever compiles or loads does so before the clock runs.
    built = [Samples(case.arm.mechanism, 16_384) for _ in range(3)]
    row: Row = {"mechanism": case.name, "function": case.way, ">joints": case.arm.dof}
    kept: dict[str, tuple[Flags, Array, float]] = {}
    for kind, joints in (("random", case.random), ("near singular", case.singular)):
        row[f">solved, {kind} %"] = "–"
        if len(joints):
            targets = case.fk(joints)
            found, times = timed(case.arm.ik, targets)
            reached = good(case, np.array([each.q for each in found]), targets)
            asked = float(np.median([each.evaluations for each in found]))
            kept[kind] = reached, times / 1e3, asked
            row[f">solved, {kind} %"] = share(reached, 2)
            label = f"{case.name} ({case.way}), {kind}"
            misses += [f"{label} {i}: q = {joints[i].tolist()}" for i in np.flatnonzero(~reached)]
            if (np.array([bool(each.success) for each in found]) != reached).any():
                print(f"  {label}: some answers are judged otherwise from outside")
    reached, times, asked = kept["random"]
    if case.way == "vectorised":
        figures.append((case.name, case.arm.dof, float(np.median(times)), 100.0 * float(reached.mean())))
    return row | {
        ">median ms": f"{np.median(times):.1f}",
        ">p99 ms": f"{np.percentile(times, 99):.1f}",
        ">poses computed": f"{asked:.0f}",
        ">samples": f"{built[0].samples:,}",
        ">sampled in ms": f"{np.median([each.build_time for each in built]) * 1e3:.0f}",
    }


def goals(figures: list[tuple[str, int, float, float]]) -> Iterator[str]:
    """What is aimed at with six joints as a vectorised function, and what came of it."""
    six = [row for row in figures if row[1] == 6]
    if six:
        slowest, worst = max(six, key=lambda row: row[2]), min(six, key=lambda row: row[3])
        fast, solved = sum(row[2] <= WANTED_MS for row in six), sum(row[3] >= WANTED_SOLVED for row in six)
        yield (
            f"Six joints, vectorised, median ≤ {WANTED_MS:g} ms: {fast} of {len(six)}; "
            f"slowest {slowest[0]}, {slowest[2]:.1f} ms."
        )
        yield (
            f"Six joints, vectorised, ≥ {WANTED_SOLVED} % of random targets: {solved} of {len(six)}; "
            f"worst {worst[0]}, {worst[3]:.2f} %."
        )


def cases(options: argparse.Namespace) -> Iterator[Case]:
    """Every arm as a vectorised function; the first in other ways, too, and mechanisms of the examples."""
    counts = options.random, options.singular, options.seed
    for name in options.arms:
        yield catalog_case(name, "vectorised", *counts)
    if options.arms == ARMS:
        yield catalog_case("ur5e", "one row", max(options.random // 5, 1), 0, options.seed)
        yield catalog_case("ur5e", "Numba, one row", *counts)
        for example, variable in (("07_continuum", "robot"), ("08_five_bar", "linkage")):
            yield example_case(example, variable, options.random, options.seed)


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__,
        __doc__,
        arms=ARMS,
        page="black_box.md",
        random=(1000, 50, "random targets a mechanism"),
        singular=(500, 20, "near-singular targets an arm"),
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    options = parser.options()
    page, misses = Page("Black-box kinematics", "benchmarks.black_box", __doc__), list[str]()
    figures: list[tuple[str, int, float, float]] = []
    page.rows(measure(case, figures, misses) for case in cases(options))
    page.head("Goals and results")
    page.items(goals(figures))
    list_misses(page, misses)
    page.end(options)


if __name__ == "__main__":
    main()
