"""Random calls of random arms: each ends soon, in numbers that plain forward kinematics confirms or in a KinseekError.

    python -m tests.fuzz.calls --count 20000 --seed 0

Arms have 1 to 20 joints, lengths from 1e-6 to 1e6 m, and limits that are narrow, equal, usual, of many turns, or none. What
counts as a finding: an exception that is no KinseekError, a warning of NumPy's, a call of more than ten seconds, NaN or
infinity, a joint outside its limits, a negative error, a success that `tests/reference.py` denies, a bound that is none.
Case i of a seed is always the same; ``--show I`` prints it. Calls run in another process, so that one that never returns is
a finding like any other.
"""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek
from kinseek import Goal
from kinseek.branches.order import ORDERS
from kinseek.errors import InternalError, InvalidRobot, KinseekError
from kinseek.ranges import AXES
from kinseek.robots.joints import Joint, serial_chain
from kinseek.support.transforms import rotation, transform

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
plain: Any = importlib.import_module("reference")

Array = NDArray[np.float64]
Rng = np.random.Generator

PER_ARM = 20
"""Calls of each arm."""

MOST_SECONDS = 10.0
"""What one call may take [s], of the clock or of the processors, whichever is less: the machine may be busy."""

PATIENCE = 40
"""When a call that never returns is given up, in seconds of the processors."""

ROUNDING = 1e-13
"""What plain forward kinematics may differ by, relative to all lengths and turns."""

KINDS = ("revolute", "continuous", "prismatic")
LIMITS = ("usual", "usual", "narrow", "equal", "many turns", "full turn")


class Finding(AssertionError):
    """What must not be."""


def require(holds: Any, what: str) -> None:
    """Report a finding unless something holds."""
    if not np.all(holds):
        raise Finding(what)


# Arms and goals


def unit(rng: Rng) -> Array:
    """A direction, often along an axis."""
    if rng.random() < 0.5:
        return np.asarray(np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0]))
    vector = rng.normal(size=3)
    return np.asarray(vector / np.linalg.norm(vector))


def placed(rng: Rng, scale: float) -> Array:
    """A transform: often no turn or a quarter turn, and a link that may be nothing."""
    angle = rng.choice([0.0, np.pi / 2, np.pi, rng.uniform(-np.pi, np.pi)])
    length = scale * rng.choice([0.0, 1e-14, rng.random(), 10.0 ** rng.uniform(-3, 0)])
    return transform(rotation(unit(rng), angle), length * unit(rng))


def limits_of(rng: Rng, kind: str, scale: float) -> tuple[float, float]:
    """Lower and upper limit [rad or m]."""
    size = scale if kind == "prismatic" else 1.0
    low = size * rng.uniform(-3, 2)
    style = rng.choice(LIMITS)
    if style == "equal":
        return low, low
    if style == "narrow":
        return low, low + size * 10.0 ** rng.uniform(-12, -2)
    if style == "many turns" and kind != "prismatic":
        turns = 10.0 ** rng.uniform(1, 3.6)
        return (-turns, turns) if rng.random() < 0.5 else (low, low + turns)
    if style == "full turn" and kind != "prismatic":
        return low, low + 2 * np.pi * rng.integers(1, 3)
    return low, low + size * rng.uniform(0.1, 6.0)


def arm_of(rng: Rng) -> kinseek.Arm:
    """A random arm."""
    dof = int(rng.integers(1, 8) if rng.random() < 0.8 else rng.integers(1, 21))
    scale = 10.0 ** rng.uniform(-6, 6)
    joints = []
    for i in range(dof):
        kind = str(rng.choice(KINDS, p=[0.6, 0.2, 0.2]))
        joints.append(Joint(f"j{i}", kind, placed(rng, scale), unit(rng), *limits_of(rng, kind, scale)))
    if rng.random() < 0.15:
        follower = str(rng.choice(["revolute", "prismatic"]))
        factor = float(rng.choice([-1.0, 0.5, 2.0, scale if follower == "prismatic" else 0.3]))
        leader = f"j{rng.integers(dof)}"
        joint = Joint("m", follower, placed(rng, scale), unit(rng), 0.0, 0.0, leader, factor, 0.1)
        joints.insert(int(rng.integers(len(joints) + 1)), joint)
    chain = serial_chain(joints, placed(rng, scale), name="random", base="base", tip="tip")
    arm = kinseek.Arm(chain)
    if rng.random() < 0.03:
        return kinseek.Arm.from_fk(arm.fk, chain.lower, chain.upper, kinds=chain.kinds)
    return arm


def an_arm(rng: Rng) -> kinseek.Arm:
    """A random arm that is not refused: a follower may be led farther than lengths may be."""
    for _ in range(100):
        try:
            return arm_of(rng)
        except InvalidRobot:
            continue
    raise Finding("a hundred arms were refused")


def size_of(arm: kinseek.Arm) -> float:
    """Sum of all lengths of an arm [m]; of a function, that of the poses it gives."""
    if arm.axes is None:
        q = arm.lower + np.random.default_rng(0).random((20, arm.dof)) * (arm.upper - arm.lower)
        return float(np.abs(arm.fk(q)[:, :3, 3]).max())
    chain = arm.chain
    length = float(np.linalg.norm(chain.fixed[:, :, 3], axis=1).sum())
    ends = np.maximum(np.abs(chain.lower), np.abs(chain.upper))[chain.leader]
    return length + float(((np.abs(chain.multiplier) * ends + np.abs(chain.offset)) * chain.prismatic).sum())


def joints_of(rng: Rng, arm: kinseek.Arm, count: int | None = None) -> Array:
    """Joint values inside the limits, some of them at a limit, (n,) or (count, n)."""
    shape = (arm.dof,) if count is None else (count, arm.dof)
    shares = rng.random(shape)
    shares = np.where(rng.random(shape) < 0.1, np.round(shares), shares)
    return np.clip(arm.lower + shares * (arm.upper - arm.lower), arm.lower, arm.upper)


def near_of(rng: Rng, arm: kinseek.Arm, count: int | None) -> Array:
    """Where an answer shall be near to: inside the limits, a little outside, or far off."""
    q = joints_of(rng, arm, count if rng.random() < 0.5 else None)
    way = rng.choice([0.0, 0.1, 10.0, 1e4])
    return np.asarray(q + way * rng.normal(size=q.shape))


def options_of(rng: Rng, scale: float) -> dict[str, Any]:
    """Tolerances, weights, a tool, a base."""
    options: dict[str, Any] = {}
    if rng.random() < 0.4:
        options["position_tolerance"] = float(rng.choice([0.0, 1e-6 * scale, 10.0 ** rng.uniform(-12, 7)]))
    if rng.random() < 0.3:
        options["orientation_tolerance"] = float(rng.choice([0.0, 10.0 ** rng.uniform(-9, 7)]))
    if rng.random() < 0.3:
        options["position_weight"] = float(10.0 ** rng.uniform(-15, 15))
    if rng.random() < 0.3:
        options["orientation_weight"] = float(10.0 ** rng.uniform(-15, 15))
    if rng.random() < 0.15:
        options["tool"] = placed(rng, 10.0 ** rng.uniform(-6, 6))
    if rng.random() < 0.1:
        options["base"] = placed(rng, scale)
    return options


def goal_of(rng: Rng, arm: kinseek.Arm, scale: float, count: int | None) -> Goal:
    """A goal that is reached, nearly, or not at all."""
    options = options_of(rng, scale)
    target = arm.fk(joints_of(rng, arm, count))
    if "tool" in options:
        target = target @ options["tool"]
    if "base" in options:
        target = options["base"] @ target
    style = rng.integers(4)
    if style == 1:
        target = target @ placed(rng, scale * 10.0 ** rng.uniform(-9, 1))
    if style == 2:
        target = target.copy()
        target[..., :3, 3] = scale * 10.0 ** rng.uniform(-3, 1) * rng.normal(size=(*target.shape[:-2], 3))
    kinds = ["pose", "pose", "position", "pointing", "box", "free", "cone"]
    kind = rng.choice(kinds)
    if kind == "position":
        return Goal.position(target[..., :3, 3], **options)
    if kind == "pointing":
        return Goal.pointing(target[..., :3, 3], unit(rng), tuple(unit(rng)), **options)
    if kind == "pose":
        return Goal.pose(target, **options)
    names = list(rng.permutation(AXES)[: rng.integers(1, 6)])
    frames: tuple[Literal["tool", "base"], ...] = ("tool", "base")
    frame = frames[rng.integers(2)]
    if kind == "cone":
        turn, angle = str(rng.choice(["rx", "ry", "rz"])), min(10.0 ** rng.uniform(-6, 1), np.pi)
        return Goal.pose(target, free=turn, cone=angle, frame=frame, **options)
    if kind == "free":
        return Goal.pose(target, free=[str(name) for name in names], frame=frame, **options)
    box = {}
    for name in names:
        size = 1.0 if name.startswith("r") else scale
        low = size * rng.uniform(-2, 1)
        high = low + size * rng.choice([0.0, 1e-9, rng.random(), 2.0])
        if not name.startswith("r") and rng.random() < 0.2:
            low, high = (low, np.inf) if rng.random() < 0.5 else (-np.inf, high)
        box[str(name)] = (low, high)
    return Goal.pose(target, box=box, frame=frame, **options)


# Checks


def check_joints(arm: kinseek.Arm, q: Array, near: Array | None) -> None:
    """Joint values are numbers inside the limits; a continuous joint, which has none, is near its start or 0."""
    require(np.isfinite(q), f"q is not finite: {q}")
    low, high = np.broadcast_to(arm.lower, q.shape), np.broadcast_to(arm.upper, q.shape)
    if near is not None:
        free = np.array(arm.kinds) == "continuous"
        free &= arm.axes.periodic if arm.axes is not None else True
        low, high = np.where(free, near - np.pi, low), np.where(free, near + np.pi, high)
    require((q >= low) & (q <= high), f"q lies outside the limits: {q}, limits {low}, {high}")


def deviations(T: Array, G: Array, goal: Goal) -> tuple[float, float]:
    """Errors of a box goal, [m] and [rad], by SciPy; what turns about one free axis is judged by that axis alone."""
    assert goal.ranges is not None
    R, W = T[:3, :3], G[:3, :3]
    moved, turned = T[:3, 3] - G[:3, 3], R @ W.T
    if goal.frame == "tool":
        moved, turned = W.T @ moved, W.T @ R
    ends = np.array(goal.ranges)
    out = np.maximum(0.0, np.maximum(ends[:3, 0] - moved, moved - ends[:3, 1]))
    if goal.swing is not None:
        a = np.array(goal.swing)
        b = turned @ a
        tilt = float(np.arctan2(np.linalg.norm(np.cross(a, b)), a @ b))
        return float(np.linalg.norm(out)), max(tilt - goal.cone, 0.0)
    vector = Rotation.from_matrix(turned).as_rotvec()
    angle = np.linalg.norm(vector)
    both = [vector] if angle < 3.1 else [vector, vector * (1.0 - 2 * np.pi / angle)]
    far = [np.linalg.norm(np.maximum(0.0, np.maximum(ends[3:, 0] - v, v - ends[3:, 1]))) for v in both]
    return float(np.linalg.norm(out)), float(min(far))


def check_reached(arm: kinseek.Arm, q: Array, goal: Goal, target: Array, scale: float) -> None:
    """Plain forward kinematics confirms that q reaches a target."""
    T = plain.fk(arm.axes, q) if arm.axes is not None else arm.fk(q)
    T = T if goal.tool is None else T @ goal.tool
    T = T if goal.base is None else goal.base @ T
    place, turn = deviations(T, target, goal) if goal.kind == "box" else plain.errors(T, goal, target)
    lengths = scale + float(np.abs(target[:3, 3]).max())
    lengths += 0.0 if goal.tool is None else float(np.linalg.norm(goal.tool[:3, 3]))
    lengths += 0.0 if goal.base is None else float(np.linalg.norm(goal.base[:3, 3]))
    turns = 1.0 + float(np.abs(q).max())  # An angle is rounded in proportion to itself.
    require(
        place <= goal.position_tolerance + ROUNDING * arm.dof * turns * lengths,
        f"a success that is {place:g} m off, tolerance {goal.position_tolerance:g}",
    )
    slack = 1e-9 if goal.kind == "box" else 1e-12
    require(
        turn <= goal.orientation_tolerance + slack + ROUNDING * arm.dof * turns,
        f"a success that is {turn:g} rad off, tolerance {goal.orientation_tolerance:g}",
    )


def check_solution(arm: kinseek.Arm, goal: Goal, solution: Any, near: Array | None, scale: float) -> None:
    """Check an answer, or a batch of them."""
    shape = goal.shape
    require(solution.q.shape == (*shape, arm.dof), f"q has shape {solution.q.shape}")
    check_joints(arm, solution.q, near)
    for name in ("position_error", "orientation_error", "weighted_error"):
        value = getattr(solution, name)
        require(np.isfinite(value), f"{name} is not finite: {value}")
        require(np.asarray(value) >= 0.0, f"{name} is negative: {value}")
    targets = goal.target.reshape(-1, 4, 4)
    for q, success, target in zip(
        solution.q.reshape(-1, arm.dof), np.ravel(solution.success), targets, strict=True
    ):
        if success:
            check_reached(arm, q, goal, target, scale)


# Calls


def call_ik(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """One goal or a batch, with or without a start."""
    count = None if rng.random() < 0.6 else int(rng.integers(0, 12))
    goal = goal_of(rng, arm, scale, count)
    near = near_of(rng, arm, count) if rng.random() < 0.4 else None
    check_solution(arm, goal, arm.ik(goal, near=near), near, scale)


def call_plain(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """A bare pose, the short way."""
    target = arm.fk(joints_of(rng, arm))
    near = near_of(rng, arm, None) if rng.random() < 0.5 else None
    check_solution(arm, Goal.pose(target), arm.ik(target, near=near), near, scale)


def call_branches(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """Every answer."""
    goal = goal_of(rng, arm, scale, None)
    near = near_of(rng, arm, None) if rng.random() < 0.4 else None
    order = "mid-range" if near is not None else ORDERS[rng.integers(len(ORDERS))]
    count = None if rng.random() < 0.5 else int(rng.integers(1, 60))
    copies = bool(rng.random() < 0.1)
    found: Any = arm.branches(goal, near=near, order=order, count=count, copies=copies)
    check_joints(arm, found.q, near)
    for q in found.q[:: 1 + len(found.q) // 100]:  # The plain twin is slow, and copies are many.
        check_reached(arm, q, goal, goal.target, scale)


def call_prefer(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """The answer that is preferred."""
    goal = goal_of(rng, arm, scale, None)
    choice = rng.integers(3)
    if choice == 0:
        wish: dict[str, Any] = {"prefer": str(rng.choice(ORDERS))}
    elif choice == 1:
        wish = {"cost": lambda q: np.abs(q).sum(axis=1)}
    else:
        wish = {"valid": lambda q: bool(q[0] > arm.lower[0])}
    check_solution(arm, goal, arm.ik(goal, **wish), None, scale)


def call_prove(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """A proof with a small budget."""
    goal = goal_of(rng, arm, scale, None)
    found = arm.prove(goal, budget=int(rng.integers(0, 2000)))
    check_joints(arm, found.q, None)
    numbers = [found.lower_bound, found.upper_bound, found.position_error, found.orientation_error]
    require(np.isfinite(numbers), f"prove: numbers that are none: {numbers}")
    require(np.array(numbers) >= 0.0, f"prove: negative numbers: {numbers}")
    require(found.lower_bound <= found.upper_bound, f"prove: bounds crossed: {numbers}")


def call_fk(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """Poses are rigid transforms, and those of the plain twin."""
    q = joints_of(rng, arm, 5) + rng.choice([0.0, 1.0])
    poses = arm.fk(q)
    require(np.isfinite(poses), "a pose is not finite")
    chain = arm.axes
    if chain is not None:
        away = np.array([plain.fk(chain, row) for row in q]) - poses
        slack = ROUNDING * arm.dof * (1.0 + np.abs(q).max())
        require(np.abs(away[:, :3, 3]).max() <= slack * (scale + np.abs(q).max()), "fk is not the plain one")
        require(np.abs(away[:, :3, :3]).max() <= slack, "fk turns otherwise than the plain one")


def call_nonsense(rng: Rng, arm: kinseek.Arm, scale: float) -> None:
    """What cannot be answered is refused by a KinseekError."""
    good = arm.fk(joints_of(rng, arm))
    bad = good.copy()
    bad[rng.integers(4), rng.integers(4)] = rng.choice([np.nan, np.inf, -np.inf, 1e308])
    q = joints_of(rng, arm)
    wrong = np.where(np.arange(arm.dof) == rng.integers(arm.dof), rng.choice([np.nan, np.inf, 1e300]), q)
    tries: list[Callable[[], Any]] = [
        lambda: arm.ik(bad),
        lambda: arm.ik(np.array([good, bad])),
        lambda: arm.ik(good, near=np.where(np.isfinite(wrong) & (wrong < 1e299), np.nan, wrong)),
        lambda: arm.ik(good[:3]),
        lambda: arm.ik(np.ones(7)),
        lambda: arm.ik(good, near=np.ones(arm.dof + 1)),
        lambda: arm.ik(np.array([good] * 3), near=np.zeros((2, arm.dof))),
        lambda: arm.branches(bad),
        lambda: arm.fk(np.full(arm.dof, np.nan)),
        lambda: arm.fk(np.zeros((3, arm.dof + 2))),
        lambda: arm.ik(2.0 * good),
        lambda: Goal.pose(good, position_tolerance=rng.choice([np.nan, -1.0, np.inf, 1e300])),
        lambda: Goal.pose(good, orientation_weight=rng.choice([np.nan, -1.0, 0.0, 1e300, 1e-300])),
        lambda: Goal.pose(good, box={"x": (np.nan, 1.0)}),
        lambda: Goal.pose(good, box={"x": (-1e300, 1e300)}),
        lambda: Goal.position([np.nan, 0.0, 0.0]),
        lambda: Goal.position([1e300, 0.0, 0.0]),
        lambda: Goal.pointing([0.0, 0.0, 0.0], [0.0, 0.0, 0.0]),
    ]
    chosen = int(rng.integers(len(tries)))
    try:
        tries[chosen]()
    except KinseekError:
        return
    raise Finding(f"nonsense number {chosen} was not refused")


CALLS: dict[str, tuple[Callable[[Rng, kinseek.Arm, float], None], float]] = {
    "ik": (call_ik, 0.45),
    "plain": (call_plain, 0.15),
    "branches": (call_branches, 0.12),
    "prefer": (call_prefer, 0.06),
    "prove": (call_prove, 0.08),
    "fk": (call_fk, 0.06),
    "nonsense": (call_nonsense, 0.08),
}


class Outcome(NamedTuple):
    """How one case went."""

    number: int
    call: str
    seconds: float
    finding: str
    refused: bool


def case(
    seed: int, number: int, arms: dict[int, kinseek.Arm], only: tuple[str, ...] = tuple(CALLS)
) -> Outcome:
    """Make one call; arms are kept for the next of their calls."""
    which = number // PER_ARM
    if which not in arms:
        arms.clear()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # Of units that look unlikely: so they are.
            arms[which] = an_arm(np.random.default_rng([seed, which]))
    arm, rng = arms[which], np.random.default_rng([seed, which, number])
    shares = np.array([CALLS[name][1] for name in only])
    name = str(rng.choice(only, p=shares / shares.sum()))
    if name == "prove" and arm.axes is None:
        name = "ik"
    began, spent, finding, refused = time.perf_counter(), time.process_time(), "", False
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)
            warnings.simplefilter("error", RuntimeWarning)
            CALLS[name][0](rng, arm, size_of(arm))
    except InternalError as error:
        finding = f"{name}: InternalError: {error}"
    except KinseekError:
        refused = True
    except Finding as error:
        finding = f"{name}: {error}"
    except Exception as error:
        where = traceback.extract_tb(error.__traceback__)[-1]
        finding = f"{name}: {type(error).__name__}: {error} ({Path(where.filename).name}:{where.lineno})"
    # What others take does not count.
    seconds = min(time.perf_counter() - began, time.process_time() - spent)
    return Outcome(number, name, seconds, finding, refused)


# The long way


def warm() -> None:
    """Compile what calls need, so that it counts for none of them."""
    arms: dict[int, kinseek.Arm] = {}
    for number in range(3 * PER_ARM):
        case(987654321, number, arms)
    arm = kinseek.load("panda")
    target = arm.fk(np.zeros(7))
    far = target + 10.0 * np.eye(4)[:, 3:] @ np.array([[0.0, 0.0, 0.0, 0.0]])
    far[2, 3] += 5.0
    for goal in (
        Goal.pose(target),
        Goal.pose(far),
        Goal.pose(target, free="rz"),
        Goal.position(target[:3, 3]),
    ):
        arm.ik(goal)
        arm.ik(goal, near=np.zeros(7))
    arm.ik(np.array([target] * 3))
    arm.ik(np.array([target] * 3), near=np.zeros(7))
    arm.branches(target)
    kinseek.load("ur5e").branches(kinseek.load("ur5e").fk(np.ones(6)))
    arm.prove(target, budget=10)
    arm.ik(target, prefer="limits")


def run(seed: int, first: int, last: int, only: tuple[str, ...] = tuple(CALLS)) -> Iterator[Outcome]:
    """Run cases first … last-1 in other processes; one that does not return ends its process and is a finding."""
    number = first
    while number < last:
        reader, writer = os.pipe()
        child = os.fork()
        if child == 0:
            os.close(reader)
            arms: dict[int, kinseek.Arm] = {}
            with os.fdopen(writer, "w") as out:
                for each in range(number, min(number - number % PER_ARM + 40 * PER_ARM, last)):
                    signal.setitimer(signal.ITIMER_PROF, PATIENCE)  # Nobody handles it: it ends the process.
                    outcome = case(seed, each, arms, only)
                    out.write(
                        "\t".join(str(value).replace("\n", " ").replace("\t", " ") for value in outcome)
                        + "\n"
                    )
                    out.flush()
            os._exit(0)
        os.close(writer)
        with os.fdopen(reader) as lines:
            for line in lines:
                fields = line.rstrip("\n").split("\t")
                yield Outcome(int(fields[0]), fields[1], float(fields[2]), fields[3], fields[4] == "True")
                number = int(fields[0]) + 1
        _, status = os.waitpid(child, 0)
        if status:
            what = (
                "never returned" if os.WTERMSIG(status) == signal.SIGPROF else f"ended with status {status}"
            )
            yield Outcome(number, "?", float(PATIENCE), f"the call {what}", False)
            number += 1


def main(doc: str | None = __doc__, only: tuple[str, ...] = tuple(CALLS)) -> int:
    """Run some calls, and say what was found."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--show", type=int, help="run this case alone, here, and print it")
    given = parser.parse_args()
    if given.show is not None:
        arm = an_arm(np.random.default_rng([given.seed, given.show // PER_ARM]))
        print(arm.mechanism)
        print(case(given.seed, given.show, {}, only))
        return 0
    warm()
    began, findings, seconds, refused = time.perf_counter(), 0, Counter[str](), 0
    calls = Counter[str]()
    for outcome in run(given.seed, given.first, given.count, only):
        calls[outcome.call] += 1
        refused += outcome.refused
        seconds[outcome.call] = max(seconds[outcome.call], outcome.seconds)  # type: ignore[assignment]
        slow = f"took {outcome.seconds:.1f} s" if outcome.seconds > MOST_SECONDS else ""
        if outcome.finding or slow:
            findings += 1
            print(f"case {outcome.number}: {outcome.finding or outcome.call} {slow}", flush=True)
        if sum(calls.values()) % 1000 == 0:
            print(
                f"{sum(calls.values())} calls, {findings} findings, {time.perf_counter() - began:.0f} s",
                flush=True,
            )
    print(f"{sum(calls.values())} calls ({dict(calls)}), {refused} refused, {findings} findings")
    print("slowest of each [s]: " + ", ".join(f"{name} {value:.2f}" for name, value in seconds.items()))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main())
