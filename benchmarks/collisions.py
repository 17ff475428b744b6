"""Scenes: time of a check compared with coal called by hand, and poses in a cell that get a free solution.

Checks: the hulls of an arm's collision meshes against each other and against twenty boxes, at random joint values. "By
hand" is what a user of pinocchio writes: the same hulls and pairs in a model that pinocchio reads from the file, its tree
of boxes, and one call of ``computeCollisions`` for each check, with forward kinematics. Verdicts are compared, and those of
the first pass alone with coal's. This part needs a URDF with meshes, such as those of the package example-robot-data;
without one it is skipped.

Solutions: targets are the poses of random joint values that are free, so each has a free solution. Capsules stand for the
links of bundled arms, in a shelf of five boards. Every solution is checked with points along the capsules in NumPy, and by
MuJoCo with the same shapes and pairs, including those of the arm with itself.

Beside VAMP and PyRoki: see `benchmarks.scene_peers`. A peer that cannot be installed is named on the page.

Motions: random motions between free joint values, until the requested number is reported as free. MuJoCo checks ten
thousand points of each of these, with the same shapes and pairs, and with its own forward kinematics and collisions.

    python -m benchmarks.collisions --urdf panda.urdf --tip panda_hand --meshes FOLDER   # writes benchmarks/collisions.md
    python -m benchmarks.collisions --targets 50 --motions 20 --output /dev/stdout
"""

from __future__ import annotations

import multiprocessing
import time
import warnings
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.collision import Box
from kinseek.collision.engine import TOUCH
from kinseek.kernels.collision import gaps
from kinseek.robots.chain import SerialChain, joint_points

from .command import at_least_one, command, writes
from .outside import Outside
from .page import Page
from .scene_peers import beside

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent

RADIUS = 0.05
"""Of the capsules [m]."""

ARMS = ("ur5e", "panda", "iiwa14")

BOARDS = {
    "floor": ((0.5, 1.0, 0.02), (0.65, 0.0, 0.1)),
    "middle": ((0.5, 1.0, 0.02), (0.65, 0.0, 0.5)),
    "roof": ((0.5, 1.0, 0.02), (0.65, 0.0, 0.9)),
    "left": ((0.5, 0.02, 0.8), (0.65, 0.5, 0.5)),
    "right": ((0.5, 0.02, 0.8), (0.65, -0.5, 0.5)),
}


def best(work: Callable[[], Any], repeats: int = 3) -> float:
    """Least of some runs [s]."""
    times = []
    for _ in range(repeats):
        began = time.perf_counter()
        work()
        times.append(time.perf_counter() - began)
    return min(times)


def two_processes(work: Callable[[], Any]) -> float:
    """The same of two processes that do some work at once: of the one that takes longer [s]."""
    context = multiprocessing.get_context("fork")
    start, times = context.Barrier(2), context.SimpleQueue()

    def run() -> None:
        work()
        start.wait()
        times.put(best(work))

    both = [context.Process(target=run) for _ in range(2)]
    for one in both:
        one.start()
    taken: list[float] = [times.get() for _ in both]
    for one in both:
        one.join()
    return max(taken)


def by_hand(
    scene: kinseek.Scene,
    urdf: Path,
    arm: kinseek.Arm,
    folders: list[str],
    obstacles: list[Any],
    joints: dict[str, float] | None = None,
) -> Any:
    """A check of the same pairs as a user of pinocchio writes it: q -> free."""
    import coal
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    geometry = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION, package_dirs=folders)
    for thing in geometry.geometryObjects:
        if isinstance(thing.geometry, coal.BVHModelBase):
            thing.geometry.buildConvexHull(True, "Qt")
            thing.geometry = thing.geometry.convex
    bodies = [model.frames[thing.parentFrame].name for thing in geometry.geometryObjects]
    added = [body for body in scene.bodies if body not in bodies]
    for name, (shape, pose) in zip(added, obstacles, strict=True):
        geometry.addGeometryObject(pin.GeometryObject(name, 0, pin.SE3(pose), shape.geometry()))
        bodies.append(name)
    counted = {frozenset((pair.a, pair.b)) for pair in scene.pairs if pair.counts}
    for i, a in enumerate(bodies):
        for j in range(i + 1, len(bodies)):
            if frozenset((a, bodies[j])) in counted:
                geometry.addCollisionPair(pin.CollisionPair(i, j))
    placed = pin.GeometryData(geometry)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        for request in placed.collisionRequests:  # Random joint values: the answer before is no good start.
            request.enable_cached_gjk_guess = False
    tree = pin.BroadPhaseManager_DynamicAABBTreeCollisionManager(model, geometry, placed)
    full, places = pin.neutral(model), [model.joints[model.getJointId(n)].idx_q for n in arm.joint_names]
    for name, value in (joints or {}).items():
        full[model.joints[model.getJointId(name)].idx_q] = value

    def free(q: Array) -> bool:
        full[places] = q
        assert geometry.ngeoms  # The tree has pointers to it, and does not keep it.
        return not pin.computeCollisions(model, data, tree, full, True)

    return free


def checks(page: Page, options: Any) -> None:
    """What a check costs."""
    arm = kinseek.load(options.urdf, tip=options.tip)
    scene = kinseek.Scene.of(arm, meshes=options.meshes)
    boxes = add_boxes(scene)
    hand = by_hand(scene, options.urdf, arm, [str(folder) for folder in options.meshes], boxes)
    q = arm.sample(options.checks, seed=1)
    verdicts = np.array([hand(one) for one in q])
    same = int((scene.free(q) == verdicts).sum())
    bare = best(lambda: [hand(one) for one in q])
    single = best(lambda: [scene.free(one) for one in q])
    batch = best(lambda: scene.free(q, threads=1))
    few = q[: max(len(q) // 20, 1)]
    distance = best(lambda: scene.distance(few)) * len(q) / len(few)
    page.head(f"One check of {arm.name} with itself and twenty boxes")
    page.say(
        f"{len(q):,} random joint values, {verdicts.mean():.0%} of them free, {sum(p.counts for p in scene.pairs)} pairs of",
        f"bodies. Verdicts are the same in {same:,} of {len(q):,}.",
    )
    many = np.tile(q, (20, 1))  # So many that what a thread costs does not count.
    alone, both = (best(lambda n=n: scene.free(many, threads=n)) * len(q) / len(many) for n in (1, 2))  # type: ignore[misc]
    machine = two_processes(lambda: scene.free(many, threads=1)) * len(q) / len(many)
    branches = best(lambda: scene.free(q[:8]), 200) * len(q)  # As long as a pose with eight branches takes.
    first = best(lambda: scene._engine._broad.verdicts(q, 0.0, TOUCH))
    outside = Outside(scene, arm)
    mujoco = best(lambda: outside.depths(few)) * len(q) / len(few)
    rows = [("pinocchio and coal by hand", bare), ("MuJoCo, contacts of the same pairs", mujoco)]
    rows += [("`scene.free(q)`, one by one", single)]
    rows += [("`scene.free(q)`, a batch, one thread", batch), ("`scene.free(q)`, a batch, two threads", both)]
    rows += [("the first pass alone", first), ("eight branches of a pose in one call, all of them", branches)]
    rows += [("`scene.distance(q)`", distance)]
    page.table(
        "what | >µs a check | >relative to coal by hand",
        [(what, f"{taken / len(q) * 1e6:.2f}", f"{taken / bare:.3f}") for what, taken in rows],
    )
    page.say(
        f"The row of two threads is from a larger batch, of {len(many):,} joint values. Two threads check this batch",
        f"{alone / both:.2f} times as fast as one thread. For comparison, two processes of one thread each do",
        f"{2 * alone / machine:.2f} times the work of one in the same time.",
    )


def proofs(page: Page, options: Any) -> None:
    """How many joint values the first pass decides, and whether it is right."""
    arm = kinseek.load(options.urdf, tip=options.tip)
    scene = kinseek.Scene.of(arm, meshes=options.meshes)
    add_boxes(scene)
    engine, told, wrong = scene._engine, np.zeros(3, dtype=np.int64), np.zeros(2, dtype=np.int64)
    done = 0
    while done < options.proofs:
        q = arm.sample(min(10_000, options.proofs - done), seed=100 + done)
        verdicts, _ = engine._broad.sort_out(q, 0.0, TOUCH)
        exact = engine.exactly_free(q, 0.0)
        told += np.bincount(verdicts, minlength=3)
        wrong += [(exact & (verdicts == gaps.TOUCH)).sum(), (~exact & (verdicts == gaps.FREE)).sum()]
        done += len(q)
        print(done, *told, *wrong, flush=True)
    page.head("Results of the first pass, compared with coal")
    page.say(f"{done:,} random joint values of the same scene; coal checks each of them, too.")
    page.table(
        "result | >number | >share | >wrong",
        [
            ("free", f"{told[gaps.FREE]:,}", f"{told[gaps.FREE] / done:.3%}", wrong[1]),
            ("touching", f"{told[gaps.TOUCH]:,}", f"{told[gaps.TOUCH] / done:.3%}", wrong[0]),
            ("left to coal", f"{told[gaps.DOUBT]:,}", f"{told[gaps.DOUBT] / done:.3%}", ""),
        ],
    )


def add_boxes(scene: kinseek.Scene) -> list[Any]:
    """Twenty boxes around an arm, and their poses."""
    rng = np.random.default_rng(0)
    boxes = []
    for number in range(20):
        size, place = rng.uniform(0.05, 0.2, 3), rng.uniform(-1, 1, 3)
        boxes.append((Box(size), kinseek.pose(place, rpy=rng.uniform(-3, 3, 3))))
        scene.add(f"box{number}", *boxes[-1])
    return boxes


def shelf(name: str) -> tuple[kinseek.Arm, kinseek.Scene]:
    """An arm before a shelf."""
    arm = kinseek.load(name)
    scene = kinseek.Scene.of(arm, capsules=RADIUS)
    for board, (size, place) in BOARDS.items():
        scene.add_box(board, size, kinseek.pose(place))
    return arm, scene


def cuts_a_board(chain: SerialChain, q: Array) -> bool:
    """Is a point on the line through the joints, from the second on, nearer to a board than the capsules are thick?"""
    points = joint_points(chain, q)[1:]
    along = np.linspace(0.0, 1.0, 50)[:, None]
    dense = np.concatenate([a + along * (b - a) for a, b in pairwise(points)])
    for size, place in BOARDS.values():
        beyond = np.maximum(np.abs(dense - place) - np.array(size) / 2, 0.0)
        if (np.linalg.norm(beyond, axis=1) < RADIUS - 1e-6).any():
            return True
    return False


def free_joints(arm: kinseek.Arm, scene: kinseek.Scene, count: int) -> Array:
    """Random joint values that are free and inside the shelf or before it."""
    found: list[Array] = []
    for seed in range(1000):
        q = arm.sample(2000, seed=seed)
        tip = arm.fk(q)[:, :3, 3]
        inside = (tip[:, 0] > 0.3) & (np.abs(tip[:, 1]) < 0.5) & (tip[:, 2] > 0.1) & (tip[:, 2] < 0.9)
        q = q[inside]
        found += list(q[scene.free(q)]) if len(q) else []
        if len(found) >= count:
            break
    return np.array(found[:count])


def answers(page: Page, count: int) -> None:
    """How many poses get a free answer, and what one costs."""
    rows = []
    for name in ARMS:
        arm, scene = shelf(name)
        targets = arm.fk(free_joints(arm, scene, count))
        arm.ik(targets[0], scene=scene)
        outside = Outside(scene, arm)
        times, solved, first, wrong, touch = [], 0, 0, 0, 0
        for target in targets:
            began = time.perf_counter()
            solution = arm.ik(target, scene=scene)
            times.append(time.perf_counter() - began)
            solved += solution.success
            first += solution.success and solution.blocked == 0
            wrong += solution.success and cuts_a_board(arm.chain, solution.q)
            touch += solution.success and bool(outside.depths(solution.q[None])[0] > 0)
        rows.append(
            (
                name,
                len(targets),
                solved,
                first,
                wrong,
                touch,
                f"{np.median(times) * 1e3:.2f}",
                f"{max(times) * 1e3:.1f}",
            )
        )
        print(*rows[-1], flush=True)
    page.head("Solutions in a shelf")
    page.say(
        "Targets are poses of random joint values at which the arm is free. *Cut a board* counts solutions in which the",
        "line through the joints comes nearer to a board than the capsules are thick.",
    )
    page.table(
        "arm | >targets | >solved | >by the first branch | >cut a board | >touch, by MuJoCo | >median ms | >largest ms",
        rows,
    )


def motions(page: Page, count: int, points: int) -> None:
    """Random motions until so many are called free, and whether they are: MuJoCo looks at many points of each."""
    rows, along = [], np.linspace(0.0, 1.0, points)[:, None]
    for name in ARMS:
        arm, scene = shelf(name)
        outside, rng = Outside(scene, arm), np.random.default_rng(0)
        ends = free_joints(arm, scene, 1000)
        asked = called = touch = 0
        taken, deepest = 0.0, 0.0
        while called < count:
            a = ends[rng.integers(len(ends), size=100)]
            b = a + rng.uniform(0.0, 0.5, (100, 1)) * (ends[rng.integers(len(ends), size=100)] - a)
            began = time.perf_counter()
            free = scene.free_motion(a, b)
            taken, asked = taken + time.perf_counter() - began, asked + len(a)
            for one, other in zip(a[free][: count - called], b[free], strict=False):
                depth = float(outside.depths(one + along * (other - one)).max())
                called, touch, deepest = called + 1, touch + (depth > 0), max(deepest, depth)
        rows.append((name, asked, called, touch, f"{deepest * 1e3:.3g}", f"{taken / asked * 1e3:.2f}"))
        print(*rows[-1], flush=True)
    page.head("Motions that are reported as free")
    page.say(f"MuJoCo checks {points:,} points of each motion that `scene.free_motion` reports as free.")
    page.table("arm | >motions | >reported as free | >of these touching | >deepest mm | >ms a motion", rows)


def main() -> None:
    """Measure and write the page."""
    parser = command(__file__, __doc__)
    parser.add_argument("--urdf", type=Path, help="a file with collision meshes")
    parser.add_argument("--tip", help="its last link")
    parser.add_argument("--meshes", type=Path, nargs="*", default=[], help="folders of its packages")
    parser.add_argument(
        "--srdf", type=Path, help="pairs that do not count beside VAMP, which has some of its own"
    )
    parser.add_argument("--checks", type=at_least_one, default=5000, help="joint values to check")
    parser.add_argument("--proofs", type=at_least_one, default=1_000_000, help="verdicts to compare")
    parser.add_argument("--targets", type=at_least_one, default=1000, help="targets an arm")
    parser.add_argument("--motions", type=at_least_one, default=1000, help="motions called free, an arm")
    parser.add_argument("--points", type=at_least_one, default=10_000, help="points of a motion")
    writes(parser, "--output", HERE / "collisions.md", "page to write")
    options = parser.parse_args()
    page = Page("Scenes", "benchmarks.collisions")
    if options.urdf:
        checks(page, options)
        proofs(page, options)
        beside(page, options, by_hand, best)
    answers(page, options.targets)
    motions(page, options.motions, options.points)
    page.write(options.output)


if __name__ == "__main__":
    main()
