"""Black-box kinematics: share of reachable targets solved, time of a call, and number of poses that the function computes.

Every arm of the list is wrapped by `Arm.from_fk` as a function: vectorised NumPy, the same function one row at a time, and
a Numba function one row at a time. A continuum robot and a five-bar linkage come from the examples. A target is solved if
plain NumPy forward kinematics confirms the result within 1e-6 m and 1e-6 rad, and every joint is inside its limits. Times
are those of single calls `arm.ik(T)` from Python. Every miss is listed by name.

    python -m benchmarks.black_box                 # writes benchmarks/black_box.md
    python -m benchmarks.black_box ur5e --random 200 --output /dev/stdout
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, cast

import numba
import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.robots.chain import SerialChain
from kinseek.solvers.black_box.samples import Samples

from .command import arm_name, at_least_one, command, writes
from .page import Page
from .targets import fleet_arm, plain_fk, pose_errors, random_joints, singular_joints
from .timing import timed

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

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


@dataclass(frozen=True)
class Row:
    """One line of the table."""

    cells: dict[str, object]
    misses: list[str]
    six: bool
    """Whether it counts for what is aimed at: six joints, vectorised."""
    median: float
    """[ms]"""
    missed: float
    """Of random targets [%]."""


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
    chain = fleet_arm(name).chain
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
    names = _definitions(HERE.parent / "examples" / f"{example}.py")
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


def good(case: Case, q: Array, targets: Array) -> NDArray[np.bool_]:
    """Which answers, (k, n), are strict by plain forward kinematics?"""
    away, angle = pose_errors(case.fk(q), targets)
    inside = ((q >= case.arm.lower) & (q <= case.arm.upper)).all(axis=1)
    return np.asarray(inside & (away <= 1e-6) & (angle <= 1e-6))


def measure(case: Case) -> Row:
    """Solve every target by a call of its own."""
    case.arm.ik(case.fk(case.random[:1])[0])  # Whatever compiles or loads does so before the clock runs.
    built = [Samples(case.arm.mechanism, 16_384) for _ in range(3)]
    name, way = case.name, case.way
    cells: dict[str, object] = {"mechanism": name, "function": way, ">joints": case.arm.dof}
    misses, missed, times, asked = [], [], np.empty(0), 0.0
    for kind, joints in (("random", case.random), ("near singular", case.singular)):
        column = f">solved, {kind} %"
        if not len(joints):
            cells[column] = "–"
            continue
        targets = case.fk(joints)
        found, taken = timed(case.arm.ik, targets)
        if kind == "random":
            times, asked = taken / 1e3, statistics.median(each.evaluations for each in found)
        reached = good(case, np.array([each.q for each in found]), targets)
        wrong = int((np.array([bool(each.success) for each in found]) != reached).sum())
        if wrong:
            print(f"  {name}: {wrong} answers are judged otherwise from outside")
        at = np.flatnonzero(~reached)
        misses += [
            f"{name} ({way}), {kind} {i}: q = {np.array2string(joints[i], max_line_width=200)}" for i in at
        ]
        missed.append(100.0 * len(at) / len(joints))
        cells[column] = f"{np.floor(1e4 * reached.mean()) / 1e2:.2f}"
    median = float(np.median(times))
    cells |= {
        ">median ms": f"{median:.1f}",
        ">p99 ms": f"{np.percentile(times, 99):.1f}",
        ">poses computed": f"{asked:.0f}",
        ">samples": f"{built[0].samples:,}",
        ">sampled in ms": f"{statistics.median(each.build_time for each in built) * 1e3:.0f}",
    }
    return Row(cells, misses, case.arm.dof == 6 and way == "vectorised", median, missed[0])


def page(rows: list[Row], random: int, singular: int) -> Page:
    """The page."""
    page = Page("Black-box kinematics", "benchmarks.black_box")
    page.say(
        f"For each arm, {random:,} targets are poses of joint values uniform inside the limits, and {singular:,} of joint",
        "values near singularities and limits. The searches get no starting guess. A target is solved if the result is",
        "within 1e-6 m and 1e-6 rad by plain NumPy forward kinematics, and inside the limits. Times are wall times of one",
        "call `arm.ik(T)`. *Poses computed* is the median number of poses that the function computes for a target.",
    )
    page.rows([row.cells for row in rows])
    if six := [row for row in rows if row.six]:
        slowest, worst = max(six, key=lambda row: row.median), max(six, key=lambda row: row.missed)
        solved = sum(row.missed <= 100.0 - WANTED_SOLVED for row in six)
        page.head("Goals and results")
        page.items(
            [
                f"Six joints, vectorised, median ≤ {WANTED_MS:g} ms: {sum(row.median <= WANTED_MS for row in six)} of "
                f"{len(six)}; slowest {slowest.cells['mechanism']}, {slowest.median:.1f} ms.",
                f"Six joints, vectorised, ≥ {WANTED_SOLVED} % of random targets: {solved} of {len(six)}; "
                f"worst {worst.cells['mechanism']}, {100.0 - worst.missed:.2f} %.",
            ]
        )
    misses = [miss for row in rows for miss in row.misses]
    page.head(f"Misses: {len(misses)}")
    page.items(misses)
    return page


def main() -> None:
    """Measure, print as it goes, write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("arms", nargs="*", type=arm_name, help="names; the list and the examples by default")
    parser.add_argument("--random", type=at_least_one, default=1000, help="random targets a mechanism")
    parser.add_argument("--singular", type=int, default=500, help="near-singular targets an arm")
    parser.add_argument("--seed", type=int, default=0, help="seed of the targets")
    writes(parser, "--output", HERE / "black_box.md", "page to write")
    options = parser.parse_args()
    counts = (options.random, options.singular, options.seed)
    cases = [catalog_case(name, "vectorised", *counts) for name in options.arms or ARMS]
    if not options.arms:
        few = (max(options.random // 5, 1), 0, options.seed)
        cases += [catalog_case("ur5e", "one row", *few), catalog_case("ur5e", "Numba, one row", *counts)]
        cases += [
            example_case("07_continuum", "robot", options.random, options.seed),
            example_case("08_five_bar", "linkage", options.random, options.seed),
        ]
    rows = []
    for case in cases:
        rows.append(measure(case))
        print(*rows[-1].cells.values(), f"missed {len(rows[-1].misses)}", flush=True)
    page(rows, options.random, options.singular).write(options.output)


if __name__ == "__main__":
    main()
