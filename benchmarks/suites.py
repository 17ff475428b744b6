"""The goals of other projects' tests and benchmarks, solved, and judged by pinocchio.

No part of these suites is in this repository: clone the ones that you want, and give their folders. Each is recognised by
its contents.

- *EAIK* (OstermD/EAIK, BSD-3-Clause; Ostermeier et al. 2025): the arms that its system tests solve for poses, with the
  same number of random joint values. Known solutions are these joint values, and those that EAIK, where it is installed,
  finds to 1e-6 on arms without a locked joint.
- *stereo-sew* (rpiRobotics/stereo-sew, BSD-3-Clause; Elias and Wen 2024): the ten families of random arms of seven joints of
  its correctness tests, 100 arms of each with random joint values.
- *ssik* (personalrobotics/ssik, BSD-3-Clause): the URDF files of its fixtures, by the solver that it chooses for them, at
  the joint values of its manifest and of its tests that are inside the limits, and at random ones. Arms of seven joints
  get a twentieth as many, because each needs an arm of its own with a locked joint. There are no other known solutions.
- *robometrics* (fishbotics/robometrics, MIT; its data MIT and BSD-3-Clause): goals of a Panda's hand in scenes, with listed
  joint values. Each set that is there in full is read; the two large ones are in Git LFS, one of which is
  MotionBenchMaker's.
- *MotionBenchMaker*, as VAMP has it (folder `resources/panda` of KavrakiLab/vamp, Apache-2.0; Chamzas et al. 2022): the
  poses in which its problems end, in their scenes. robometrics needs this folder, too, for the hulls of the Panda.
- *RM4D* (mrudorfer/rm4d, MIT; Rudorfer 2025): the grasps of its example of a base position, 200 for each of four objects on
  a floor of 2 m by 2 m. `maps.best_base` chooses the position of a Panda among the centres of 5 cm cells. *Reached* counts
  the grasps that `arm.ik` solves from there, *confirmed* those that pinocchio confirms, and *proved out of reach* those for
  which `arm.prove` has a proof.

A goal is *exact* if `arm.ik` reports a success, and pinocchio finds from the URDF file that its joint values reach the goal
within 1e-6 m and 1e-6 rad and are inside the limits. A known solution is *found* if `arm.branches` has it within 1e-3 rad
modulo 2π. On arms of seven joints, the joints that the test names, or else the third one, are locked at the values of the
known solution, so that in general finitely many solutions remain. *On self-motions* counts known solutions where infinitely
many remain; such a solution is found if `arm.ik(T, near=...)` returns it. *Wrong* counts branches that pinocchio does not
confirm. *Free in the scene* counts goals that are exact and whose joint values touch nothing by MuJoCo. Times are medians of
the second call of each goal.

    python -m benchmarks.suites EAIK ssik stereo-sew robometrics vamp/resources/panda rm4d    # writes benchmarks/suites.md
    python -m benchmarks.suites EAIK --quick                                                  # a few of each, printed
"""

from __future__ import annotations

import argparse
import ast
import operator
import re
import tempfile
import time
import tomllib
from collections.abc import Callable, Iterator
from copy import copy
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml  # type: ignore[import-untyped]
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import kinseek

from .command import command
from .field.judge import STRICT, Judge, good
from .outside import Outside
from .page import Page, Row
from .problems import Cell, tasks
from .targets import Array

SAME = 1e-3
"""[rad]"""


OPERATORS: dict[type, Callable[[Any, Any], Any]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
}
"""In the vectors of EAIK's tests."""


class Model(NamedTuple):
    """An arm, and pinocchio's view of the same file."""

    name: str
    arm: kinseek.Arm
    judge: Judge

    @classmethod
    def read(cls, name: str, path: Path, base: str, tip: str) -> Model:
        """Read a URDF file."""
        return cls(name, kinseek.load(path, base=base, tip=tip), Judge(path, base, tip))

    @classmethod
    def written(cls, name: str, axes: Array, origins: Array) -> Model:
        """Write a URDF file of an arm, and read it.

        Args:
            name: Of the arm.
            axes: Of its joints, (n, 3).
            origins: Of the joints and of the tip in the one before, x y z [m] and roll pitch yaw [rad], (n + 1, 6).
        """
        parts = [f'<link name="link{i}"/>' for i in range(len(axes) + 2)]
        for i, (*place, r, p, y) in enumerate(origins.tolist()):
            last = i == len(axes)
            turned = "" if last else f'<axis xyz="{" ".join(map(repr, axes[i].tolist()))}"/>'
            parts.append(
                f'<joint name="joint{i}" type="{"fixed" if last else "revolute"}"><parent link="link{i}"/>'
                f'<child link="link{i + 1}"/><origin xyz="{" ".join(map(repr, place))}" rpy="{r} {p} {y}"/>{turned}'
                f'<limit lower="{-np.pi}" upper="{np.pi}" effort="1" velocity="1"/></joint>'
            )
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "arm.urdf"
            path.write_text(f'<robot name="arm">{"".join(parts)}</robot>', encoding="utf-8")
            return cls.read(name, path, "link0", f"link{len(axes) + 1}")

    def asked(self, kind: str, q: Array, fixed: tuple[int, ...] = ()) -> Iterator[Goal]:
        """Goals at joint values, (k, n), which are their known solutions."""
        if not fixed and self.arm.dof > 6:
            fixed = (2,)
        for values, T in zip(q, self.judge.fk(q), strict=True):
            yield Goal(kind, self, T, values[None], fixed)


class Goal(NamedTuple):
    """A goal of a suite."""

    kind: str
    """Suite and part of it: a row of the table."""
    model: Model
    T: Array
    known: Array
    """Solutions that the suite knows, (k, n)."""
    fixed: tuple[int, ...] = ()
    """Joints that are locked at the values of a known solution when all branches are asked for."""
    scene: kinseek.Scene | None = None


class Found(NamedTuple):
    """What came of a goal."""

    exact: bool
    listed: int
    found: int
    sampled: int
    """Of the known solutions, those of which there are infinitely many."""
    wrong: int
    ik: float
    branches: float
    """Times [µs]."""
    free: bool


def eaik(folder: Path, count: int) -> Iterator[Goal]:
    """The system tests of EAIK: arms of three to seven joints whose poses it asks for."""
    rng = np.random.default_rng(42)
    for file in sorted((folder / "CPP" / "Tests" / "System_Tests").glob("*R/*.cpp")):
        for text in file.read_text(encoding="utf-8").split("\nbool ")[1:]:
            title = re.search(r'return evaluate_test<EAIK::Robot>\("(.*?)"', text)
            given = {
                name: _vectors(body) for name, body in re.findall(r"\b(\w*[HP]|a|alpha|d) ?<< ?(.*?);", text)
            }
            if title is None or not given:
                continue
            if (
                "alpha" in given
            ):  # Standard Denavit-Hartenberg: each joint turns about z, and then come d, a and alpha.
                origins = np.zeros((7, 6))
                origins[1:, 0], origins[1:, 2], origins[1:, 3] = given["a"], given["d"], given["alpha"]
                H, P = np.tile([0.0, 0.0, 1.0], (6, 1)), None
            else:
                H, P = (next(v for name, v in given.items() if name.endswith(end)) for end in "HP")
                origins = np.hstack([P, np.zeros_like(P)])
            model = Model.written(title[1], H, origins)
            locked = [(int(i), value) for i, value in re.findall(r"double>\((\d), (\w+)\)", text)]
            q = rng.uniform(-np.pi, np.pi, (count, len(H)))
            for i, value in locked:
                q[:, i] = 0.0 if f"{value} = 0;" in text else q[0, i]
            goals = model.asked(f"EAIK, {file.stem[-2:]}", q, tuple(i for i, _ in locked))
            other = None if P is None or locked else _robot(H, P)
            yield from goals if other is None else (_completed(goal, other) for goal in goals)


def _vectors(text: str) -> Array:
    """Evaluate a list of sums of ex, ey and ez, or of numbers, as C++ has it."""
    names: dict[str, Any] = {
        "ex": np.eye(3)[0],
        "ey": np.eye(3)[1],
        "ez": np.eye(3)[2],
        "zv": np.zeros(3),
        "M_PI": np.pi,
    }

    def value(node: ast.expr) -> Any:
        match node:
            case ast.Name(id=name):
                return names[name]
            case ast.Constant(value=number):
                return number
            case ast.UnaryOp(op=ast.USub(), operand=one):
                return -value(one)
            case ast.BinOp(left=a, op=op, right=b):
                return OPERATORS[type(op)](value(a), value(b))
        raise ValueError(f"not understood: {ast.unparse(node)}")

    tree = ast.parse(f"({text.strip()},)", mode="eval").body
    assert isinstance(tree, ast.Tuple)
    return np.array([value(each) for each in tree.elts], dtype=np.float64)


def _robot(H: Array, P: Array) -> Any:
    """EAIK's solver of an arm; None where it is not installed, or has none."""
    try:
        from eaik.IK_HP import HPRobot
    except ImportError:
        return None
    robot = HPRobot(H, P)
    return robot if robot.hasKnownDecomposition() else None


def _completed(goal: Goal, robot: Any) -> Goal:
    """Add what EAIK finds, if it is exact."""
    q = np.asarray(robot.IK(goal.T).Q, dtype=np.float64).reshape(-1, goal.model.arm.dof)
    q = (q + np.pi) % (2.0 * np.pi) - np.pi
    return goal._replace(known=np.vstack([goal.known, q[_exact(goal, q)]]))


def stereo_sew(folder: Path, count: int) -> Iterator[Goal]:
    """The correctness tests of stereo-sew; without its SEW angle, of which the locked joint takes the place."""
    rng = np.random.default_rng(42)
    for file in sorted((folder / "+SEW_IK_setups").glob("*.m")):
        text = re.sub(r"%.*", "", file.read_text(encoding="utf-8"))
        offsets = re.search(r"P\.kin\.P = (?:\[(.*?)\]|rand_vec\(8\));", text)
        assert offsets is not None
        zero = [name == "zv" for name in (offsets[1] or "rand_vec " * 8).split()]
        parallel = re.findall(r"kin\.H\(:,(\d)\) = P\.kin\.H\(:,(\d)\);", text)
        for number in range(min(count, 100)):
            origins = np.zeros((8, 6))
            origins[:, :3] = np.where(np.array(zero)[:, None], 0.0, rng.uniform(-1.0, 1.0, (8, 3)))
            H = rng.normal(size=(7, 3))
            H /= np.linalg.norm(H, axis=1, keepdims=True)
            for i, j in parallel:
                H[int(i) - 1] = H[int(j) - 1]
            model = Model.written(f"{file.stem} {number}", H, origins)
            yield from model.asked(f"stereo-sew, {file.stem[3:]}", rng.uniform(-np.pi, np.pi, (1, 7)))


def ssik(folder: Path, count: int) -> Iterator[Goal]:
    """The fixtures of ssik that are URDF files."""
    rng = np.random.default_rng(42)
    arms = tomllib.loads((folder / "src/ssik/prebuilt/MANIFEST.toml").read_text(encoding="utf-8"))["arms"]
    picked: dict[str, list[list[float]]] = {}
    for file in (folder / "tests").glob("test_*.py"):
        text = file.read_text(encoding="utf-8")
        block = re.search(r"^_HAND_PICKED_Q = \[\n(.*?)^\]", text, re.M | re.S)
        fixtures = set(re.findall(r'"(\w+\.urdf)"', text))
        if block is not None and len(fixtures) == 1:
            rows = re.findall(r"np\.array\(\s*\[(.*?)\]", block[1], re.S)
            picked[fixtures.pop()] = [[float(x) for x in row.split(",") if x.strip()] for row in rows]
    for name, entry in sorted(arms.items(), key=lambda item: (item[1]["solver"], item[0])):
        if not entry["fixture"].endswith(".urdf"):
            continue
        path = folder / "tests" / "fixtures" / entry["fixture"]
        model = Model.read(name, path, entry["base_link"], entry["ee_link"])
        ends = model.judge.arm.lower, model.judge.arm.upper
        own = np.array([entry["sample_q"], *picked.get(entry["fixture"], [])])
        own = own[((own >= ends[0]) & (own <= ends[1])).all(axis=1)]
        many = rng.uniform(*ends, (count if model.arm.dof < 7 else max(1, count // 20), model.arm.dof))
        yield from model.asked(f"ssik, {entry['solver']}", np.vstack([own, many]))


def robometrics(folder: Path, cell: Cell, model: Model, count: int) -> Iterator[Goal]:
    """The sets of robometrics that are there in full, with the hulls of the Panda."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    for file in sorted((folder / "robometrics" / "content" / "dataset").glob("*_set.yaml")):
        sets = yaml.load(file.read_text(encoding="utf-8"), loader)
        if "oid" in sets or isinstance(sets, str):  # A pointer of Git LFS.
            continue
        for name, each in sets.items():
            for problem in each[:count]:
                yield _placed(f"robometrics, {name}", problem, cell, model)
            for problem in each[:count]:
                q = np.array(problem["goal_ik"], dtype=np.float64)
                inside = ((q >= model.arm.lower) & (q <= model.arm.upper)).all(axis=1)
                yield from model.asked(f"robometrics, {name}, listed", np.unique(q[inside], axis=0))


def _placed(kind: str, problem: dict[str, Any], cell: Cell, model: Model) -> Goal:
    """The goal of a problem of robometrics in its scene."""
    scene, place, obstacles = copy(cell.scene), problem["goal_pose"], problem["obstacles"]
    for name, box in obstacles.get("cuboid", {}).items():
        scene.add_box(name, box["dims"], _pose(box["pose"]))
    for name, rod in obstacles.get("cylinder", {}).items():
        scene.add_cylinder(name, rod["radius"], rod["height"], _pose(rod["pose"]))
    T = _pose([*place["position_xyz"], *place["quaternion_wxyz"]])
    return Goal(kind, model, T, np.empty((0, model.arm.dof)), (), scene)


def _pose(values: list[float]) -> Array:
    return np.asarray(kinseek.pose(values[:3], quat_wxyz=values[3:]))


def motion_bench_maker(folder: Path, cell: Cell, model: Model, count: int) -> Iterator[Goal]:
    """The ends of MotionBenchMaker's problems."""
    for task in tasks(folder):
        if task.number <= count:
            (goal,) = model.asked(f"MotionBenchMaker, {task.kind}", task.q1[None])
            yield goal._replace(scene=cell.filled(task))


def _exact(goal: Goal, q: Array) -> NDArray[np.bool_]:
    """Which joint values, (k, n), reach a goal and are inside the limits, by pinocchio."""
    verdict = goal.model.judge.judge(q, np.broadcast_to(goal.T, (len(q), 4, 4)))
    return good(verdict, STRICT, STRICT)


def twice(ask: Callable[[], Any]) -> tuple[Any, float]:
    """What a second call returns, and its time [µs]."""
    ask()
    began = time.perf_counter_ns()
    return ask(), (time.perf_counter_ns() - began) / 1e3


def answered(goal: Goal, locked: dict[tuple[float, ...], kinseek.Arm]) -> Found:
    """Ask for a solution and for all of them; arms with locked joints are kept."""
    arm = goal.model.arm
    solution, took = twice(partial(arm.ik, goal.T, scene=goal.scene))
    exact = bool(solution.success and _exact(goal, solution.q[None])[0])
    free = goal.scene is not None and exact and not Outside(goal.scene, arm).depths(solution.q[None]).any()
    found, sampled, wrong, times = 0, 0, 0, list[float]()
    fixed = list(goal.fixed)
    rest = [i for i in range(arm.dof) if i not in fixed]
    for values in np.unique(goal.known[:, fixed], axis=0):
        key = tuple(values.tolist())
        if key not in locked:
            names = [arm.joint_names[i] for i in fixed]
            locked[key] = arm.with_locked(dict(zip(names, key, strict=True))) if fixed else arm
        part = locked[key]
        branches, spent = twice(partial(part.branches, goal.T))
        times.append(spent)
        q = np.empty((len(branches.q), arm.dof))
        q[:, fixed], q[:, rest] = values, branches.q
        wrong += int((~_exact(goal, q)).sum())
        known = goal.known[(goal.known[:, fixed] == values).all(axis=1)][:, rest]
        if branches.sampled:
            sampled += len(known)
            apart = np.array([_apart(each, part.ik(goal.T, near=each).q) for each in known])
        else:
            apart = _apart(known[:, None], branches.q).min(axis=1, initial=np.inf)
        found += int((apart <= SAME).sum())
    middle = float(np.median(times)) if times else np.nan
    return Found(exact, len(goal.known), found, sampled, wrong, took, middle, free)


def _apart(q: Array, other: Array) -> Array:
    """Largest difference of a joint modulo full turns, (..., n) -> (...)."""
    return np.asarray(np.abs((q - other + np.pi) % (2.0 * np.pi) - np.pi).max(axis=-1))


def row(kind: str, goals: list[Goal], results: list[Found]) -> Row:
    """A row of the table."""
    scenes = sum(goal.scene is not None for goal in goals)
    branches = [each.branches for each in results if each.listed]
    return {
        "suite": kind,
        ">arms": len({goal.model.name for goal in goals}),
        ">goals": len(goals),
        ">exact": sum(each.exact for each in results),
        ">known solutions": sum(each.listed for each in results),
        ">found": sum(each.found for each in results),
        ">on self-motions": sum(each.sampled for each in results),
        ">wrong": sum(each.wrong for each in results),
        ">`ik` µs": f"{np.median([each.ik for each in results]):.1f}",
        ">`branches` µs": f"{np.median(branches):.0f}" if branches else "–",
        ">free in the scene": f"{sum(each.free for each in results)} of {scenes}" if scenes else "–",
    }


def every(folders: list[Path], count: int) -> Iterator[Goal]:
    """The goals of all folders, each recognised by what it contains."""
    panda = next((folder for folder in folders if (folder / "panda_spherized.urdf").is_file()), None)
    if panda is not None:
        cell = Cell.read(panda)
        model = Model("panda", cell.arm, Judge(panda / "panda.urdf", "panda_link0", "panda_hand"))
    for folder in folders:
        if (folder / "CPP").is_dir():
            yield from eaik(folder, count)
        elif (folder / "+SEW_IK_setups").is_dir():
            yield from stereo_sew(folder, count)
        elif (folder / "src" / "ssik").is_dir():
            yield from ssik(folder, count)
        elif folder == panda:
            yield from motion_bench_maker(folder, cell, model, count)
        elif (folder / "robometrics").is_dir() and panda is not None:
            yield from robometrics(folder, cell, model, count)
        else:
            raise SystemExit(
                f"{folder} is none of the suites, or the Panda of VAMP is missing beside robometrics"
            )


GRIPPER = np.array([[0.0, 1.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""The frame of the Panda's fingers in that of RM4D's grasps."""

FLOOR, CELL = 2.0, 0.05
"""Width of RM4D's floor and of the cells in which a base may stand [m]."""


def bases(folder: Path) -> Iterator[Row]:
    """The objects of RM4D's example, grasped from the best position of the base."""
    scene, robots = folder / "experiment_scripts/assets/scene01", folder / "rm4d/robots/assets/franka_panda"
    model = Model.read("panda", robots / "panda166.urdf", "panda_link0", "panda_grasptarget")
    grasps = {
        path.stem.partition("_")[2]: np.load(path) @ GRIPPER for path in sorted(scene.glob("grasps_*.npy"))
    }
    for each in grasps.values():  # They have 32 bits.
        each[:, :3, :3] = Rotation.from_matrix(each[:, :3, :3]).as_matrix()
    x, y = np.meshgrid(*[np.arange(CELL / 2.0, FLOOR, CELL)] * 2)
    places = kinseek.pose(np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1))
    began = time.perf_counter()
    ranked = kinseek.maps.best_base(model.arm, np.concatenate([*grasps.values()]), places, top=1, threads=1)
    took, base = time.perf_counter() - began, np.asarray(ranked.base[0])
    for name, each in grasps.items():
        poses = np.linalg.inv(base) @ each
        solution = model.arm.ik(poses)
        verdict = good(model.judge.judge(solution.q, poses), STRICT, STRICT)
        proofs = [model.arm.prove(T).verdict for T in poses[~solution.success]]
        yield {
            "object": name,
            ">grasps": len(each),
            ">base x m": f"{base[0, 3]:.3f}",
            ">base y m": f"{base[1, 3]:.3f}",
            ">reached": int(solution.success.sum()),
            ">confirmed": int((verdict & solution.success).sum()),
            ">proved out of reach": proofs.count(kinseek.Verdict.UNREACHABLE),
            ">positions": len(places),
            ">ranked in s": f"{took:.1f}",
        }


def measured(options: argparse.Namespace, misses: list[str]) -> Iterator[Row]:
    """Ask the goals of one kind after the other; what is not as it should be is named."""
    for kind, group in groupby(every(options.folders, options.goals), key=lambda goal: goal.kind):
        goals, results = [], []
        for model, some in groupby(group, key=lambda goal: goal.model):
            locked: dict[tuple[float, ...], kinseek.Arm] = {}
            for number, goal in enumerate(some):
                goals.append(goal)
                results.append(result := answered(goal, locked))
                bad = [] if result.exact else ["not solved"]
                bad += [f"{result.listed - result.found} not found"] * (result.found < result.listed)
                bad += [f"{result.wrong} wrong"] * (result.wrong > 0)
                bad += ["not free"] * (goal.scene is not None and result.exact and not result.free)
                if bad:
                    misses.append(f"{kind}, {model.name}, goal {number}: {', '.join(bad)}")
        yield row(kind, goals, results)


def main() -> None:
    """Ask all goals, and write the page."""
    parser = command(__file__, __doc__, page="suites.md", goals=(1000, 5, "goals an arm, or of a set"))
    parser.add_argument("folders", nargs="+", type=Path, help="clones of the suites, see above")
    options = parser.options()
    examples = [folder for folder in options.folders if (folder / "rm4d").is_dir()]
    options.folders = [folder for folder in options.folders if folder not in examples]
    page, misses = Page("Test suites of other projects", "benchmarks.suites", __doc__), list[str]()
    page.rows(measured(options, misses))
    for folder in examples:
        page.head("The base of RM4D's example")
        page.rows(bases(folder))
    page.head("Misses")
    page.say(
        "Goals with a wrong or missing result. Without `prove=True`, `branches` does not claim a complete list."
    )
    page.items(misses)
    page.end(options)


if __name__ == "__main__":
    main()
