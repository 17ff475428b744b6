"""Scenes: time of a check compared with coal called by hand, and poses in a cell that get a free solution.

Checks: the hulls of an arm's collision meshes against each other and against twenty boxes, at random joint values. "By
hand" is what a user of pinocchio writes: the same hulls and pairs in a model that pinocchio reads from the file, its tree
of boxes, and one call of ``computeCollisions`` for each check, with forward kinematics. Verdicts are compared, and those of
the first pass alone with coal's. This part needs a URDF with meshes, such as those of the package example-robot-data;
without one it is skipped.

Solutions: targets are the poses of random joint values that are free, so each has a free solution. Capsules stand for the
links of bundled arms, in a shelf of five boards. Every solution is checked with points along the capsules in NumPy, and by
MuJoCo with the same shapes and pairs, including those of the arm with itself.

Beside VAMP and PyRoki: the Panda with itself and twenty capsules, the obstacles that all of them support. A peer that
cannot be installed is named on the page.

Motions: random motions between free joint values, until the requested number is reported as free. MuJoCo checks ten
thousand points of each of these, with the same shapes and pairs, and with its own forward kinematics and collisions.

    python -m benchmarks.collisions --urdf panda.urdf --tip panda_hand --meshes FOLDER   # writes benchmarks/collisions.md
    python -m benchmarks.collisions --targets 50 --motions 20 --output /dev/stdout
"""

from __future__ import annotations

import multiprocessing
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

import kinseek
from kinseek.collision import Box, Capsule
from kinseek.collision.engine import TOUCH
from kinseek.kernels.collision import gaps
from kinseek.robots.chain import SerialChain, joint_points

from .command import command
from .outside import Outside
from .page import Page, Row
from .targets import Array
from .timing import least, timed
from .workers.process import called, releases
from .workers.scenes import CHECKERS

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


FINGERS = 0.04
"""How far the fingers are open [m]."""

SECONDS = 600
"""For one peer."""


def two_processes(work: Callable[[], Any]) -> float:
    """The same of two processes that do some work at once: of the one that takes longer [s]."""
    context = multiprocessing.get_context("fork")
    start, times = context.Barrier(2), context.SimpleQueue()

    def run() -> None:
        work()
        start.wait()
        times.put(least(work))

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
    arm, scene = among(options, "box", BOXES)
    hand = by_hand(scene, options.urdf, arm, [str(folder) for folder in options.meshes], BOXES)
    q = arm.sample(options.checks, seed=1)
    verdicts = np.array([hand(one) for one in q])
    same = int((scene.free(q) == verdicts).sum())
    bare = least(lambda: [hand(one) for one in q])
    single = least(lambda: [scene.free(one) for one in q])
    batch = least(lambda: scene.free(q, threads=1))
    few = q[: max(len(q) // 20, 1)]
    distance = least(lambda: scene.distance(few)) * len(q) / len(few)
    page.head(f"One check of {arm.name} with itself and twenty boxes")
    page.say(
        f"{len(q):,} random joint values, {verdicts.mean():.0%} of them free, {sum(p.counts for p in scene.pairs)} pairs of",
        f"bodies. Verdicts are the same in {same:,} of {len(q):,}.",
    )
    many = np.tile(q, (20, 1))  # So many that what a thread costs does not count.
    alone, both = (least(lambda n=n: scene.free(many, threads=n)) * len(q) / len(many) for n in (1, 2))  # type: ignore[misc]
    machine = two_processes(lambda: scene.free(many, threads=1)) * len(q) / len(many)
    branches = least(lambda: scene.free(q[:8]), 200) * len(q)  # As long as a pose with eight branches takes.
    first = least(lambda: scene._engine.broad.verdicts(q, 0.0, TOUCH))
    outside = Outside(scene, arm)
    mujoco = least(lambda: outside.depths(few)) * len(q) / len(few)
    taken = {
        "pinocchio and coal by hand": bare,
        "MuJoCo, contacts of the same pairs": mujoco,
        "`scene.free(q)`, one by one": single,
        "`scene.free(q)`, a batch, one thread": batch,
        "`scene.free(q)`, a batch, two threads": both,
        "the first pass alone": first,
        "eight branches of a pose in one call, all of them": branches,
        "`scene.distance(q)`": distance,
    }
    page.rows(
        {
            "what": what,
            ">µs a check": f"{time / len(q) * 1e6:.2f}",
            ">relative to coal by hand": f"{time / bare:.3f}",
        }
        for what, time in taken.items()
    )
    page.say(
        f"The row of two threads is from a larger batch, of {len(many):,} joint values. Two threads check this batch",
        f"{alone / both:.2f} times as fast as one thread. For comparison, two processes of one thread each do",
        f"{2 * alone / machine:.2f} times the work of one in the same time.",
    )


def proofs(page: Page, options: Any) -> None:
    """How many joint values the first pass decides, and whether it is right."""
    arm, scene = among(options, "box", BOXES)
    engine, told, wrong = scene._engine, np.zeros(3, dtype=np.int64), np.zeros(2, dtype=np.int64)
    done = 0
    while done < options.proofs:
        q = arm.sample(min(10_000, options.proofs - done), seed=100 + done)
        verdicts, _ = engine.broad.sort_out(q, 0.0, TOUCH)
        exact = engine.exactly_free(q, 0.0)
        told += np.bincount(verdicts, minlength=3)
        wrong += [(exact & (verdicts == gaps.TOUCH)).sum(), (~exact & (verdicts == gaps.FREE)).sum()]
        done += len(q)
        print(done, *told, *wrong, flush=True)
    page.head("Results of the first pass, compared with coal")
    page.say(f"{done:,} random joint values of the same scene; coal checks each of them, too.")
    found = (
        ("free", gaps.FREE, wrong[1]),
        ("touching", gaps.TOUCH, wrong[0]),
        ("left to coal", gaps.DOUBT, ""),
    )
    page.rows(
        {"result": name, ">number": f"{told[k]:,}", ">share": f"{told[k] / done:.3%}", ">wrong": off}
        for name, k, off in found
    )


def around(seed: int, shape: Callable[[np.random.Generator], Any]) -> list[tuple[Any, Array]]:
    """Twenty obstacles around an arm, and their poses."""
    rng = np.random.default_rng(seed)
    return [(shape(rng), kinseek.pose(rng.uniform(-1, 1, 3), rpy=rng.uniform(-3, 3, 3))) for _ in range(20)]


BOXES = around(0, lambda rng: Box(rng.uniform(0.05, 0.2, 3)))
CAPSULES = around(1, lambda rng: Capsule(rng.uniform(0.03, 0.08), rng.uniform(0.05, 0.3)))


def among(options: Any, name: str, obstacles: list[tuple[Any, Array]], **more: Any) -> Any:
    """The arm of a file with meshes, and its scene with obstacles whose names begin so."""
    arm = kinseek.load(options.urdf, tip=options.tip)
    scene = kinseek.Scene.of(arm, meshes=options.meshes, **more)
    for number, (shape, pose) in enumerate(obstacles):
        scene.add(f"{name}{number}", shape, pose)
    return arm, scene


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


def answers(name: str, count: int) -> Row:
    """How many poses get a free answer, and what one costs."""
    arm, scene = shelf(name)
    targets = arm.fk(free_joints(arm, scene, count))
    arm.ik(targets[0], scene=scene)
    outside = Outside(scene, arm)
    found, times = timed(lambda target: arm.ik(target, scene=scene), targets)
    good = [solution for solution in found if solution.success]
    return {
        "arm": name,
        ">targets": len(targets),
        ">solved": len(good),
        ">by the first branch": sum(solution.blocked == 0 for solution in good),
        ">cut a board": sum(cuts_a_board(arm.chain, solution.q) for solution in good),
        ">touch, by MuJoCo": sum(bool(outside.depths(solution.q[None])[0] > 0) for solution in good),
        ">median ms": f"{np.median(times) / 1e3:.2f}",
        ">largest ms": f"{max(times) / 1e3:.1f}",
    }


def motions(name: str, count: int, points: int) -> Row:
    """Random motions until so many are called free, and whether they are: MuJoCo looks at many points of each."""
    arm, scene = shelf(name)
    outside, rng, along = (
        Outside(scene, arm),
        np.random.default_rng(0),
        np.linspace(0.0, 1.0, points)[:, None],
    )
    ends, asked, taken = free_joints(arm, scene, 1000), 0, 0.0
    depths: list[float] = []
    while len(depths) < count:
        a = ends[rng.integers(len(ends), size=100)]
        b = a + rng.uniform(0.0, 0.5, (100, 1)) * (ends[rng.integers(len(ends), size=100)] - a)
        began = time.perf_counter()
        free = scene.free_motion(a, b)
        taken, asked = taken + time.perf_counter() - began, asked + len(a)
        for one, other in zip(a[free][: count - len(depths)], b[free], strict=False):
            depths.append(float(outside.depths(one + along * (other - one)).max()))
    return {
        "arm": name,
        ">motions": asked,
        ">reported as free": len(depths),
        ">of these touching": sum(depth > 0 for depth in depths),
        ">deepest mm": f"{max(depths) * 1e3:.3g}",
        ">ms a motion": f"{taken / asked * 1e3:.2f}",
    }


def described(scene: kinseek.Scene, arm: kinseek.Arm, options: Any, q: Array) -> dict[str, Any]:
    """What a peer may need to know of the scene with capsules."""
    turned = np.array([pose[:3, 2] * shape.length / 2 for shape, pose in CAPSULES])
    middles = np.array([pose[:3, 3] for _, pose in CAPSULES])
    links = {body for body in scene.bodies if not body.startswith("capsule")}
    ignored = [(pair.a, pair.b) for pair in scene.pairs if not pair.counts and {pair.a, pair.b} <= links]
    return {
        "urdf": str(options.urdf.resolve()),
        "folder": str(options.meshes[0].resolve()) if options.meshes else "",
        "base": arm.base,
        "joints": list(arm.joint_names),
        "fingers": FINGERS,
        "begins": middles - turned,
        "ends": middles + turned,
        "radii": np.array([shape.radius for shape, _ in CAPSULES]),
        "ignored": ignored,
        "q": q,
    }


def beside(page: Page, options: Any) -> None:
    """Ask kinseek, coal by hand and the peers about the same joint values."""
    fingers = _fingers(options.urdf)
    joints = {name: FINGERS for name, leads in fingers.items() if leads}
    arm, scene = among(options, "capsule", CAPSULES, srdf=options.srdf, joints=joints)
    q, folders = arm.sample(options.checks, seed=5), [str(folder) for folder in options.meshes]
    hand = by_hand(scene, options.urdf, arm, folders, CAPSULES, dict.fromkeys(fingers, FINGERS))
    truth = np.array([hand(each) for each in q])
    page.head(f"Beside VAMP and PyRoki: {arm.name} with itself and twenty capsules")
    page.say(
        f"{len(q):,} random joint values, {truth.mean():.0%} of them free according to coal; one thread. Each peer has its",
        "own model of the arm, and is compared with coal on the hulls of the collision meshes. From Python, VAMP takes one",
        "q and the environment with each call; only its own planner checks eight q at a time. PyRoki comes from a commit of",
        "its repository and is compiled by JAX for one core; it is made for a GPU. A false alarm is a free q that is",
        "reported as colliding, a miss is a colliding q that is reported as free. Either may come from another shape of the",
        "arm and not from an error of the peer, but a user gets this verdict.",
    )
    versions: dict[str, str] = {}
    page.rows(_beside(scene, hand, q, truth, described(scene, arm, options, q), versions))
    page.say(releases(versions))


def _beside(
    scene: kinseek.Scene, hand: Any, q: Array, truth: Any, known: dict[str, Any], versions: dict[str, str]
) -> Iterator[Mapping[str, object]]:
    few = q[: max(len(q) // 10, 1)]

    def row(who: str, single: float, batch: float | None, free: Any) -> Row:
        return {
            "who": who,
            ">µs one by one": f"{single:.1f}",
            ">µs of a batch": "–" if batch is None else f"{batch:.2f}",
            ">false alarms": f"{(truth & ~free).mean():.2%}",
            ">misses": f"{(free & ~truth).mean():.2%}",
            "": "",
        }

    def one_by_one(check: Any) -> float:
        return least(lambda: [check(each) for each in few]) / len(few) * 1e6

    yield row("pinocchio and coal by hand", one_by_one(hand), None, truth)
    batch = least(lambda: scene.free(q, threads=1)) / len(q) * 1e6
    yield row("kinseek, `scene.free(q)`", one_by_one(scene.free), batch, scene.free(q))
    for peer, (place, _, _) in CHECKERS.items():
        found = called(place, "benchmarks.workers.scenes", "check", SECONDS, peer=peer, scene=known)
        if isinstance(found, str):
            columns = ">µs one by one", ">µs of a batch", ">false alarms", ">misses"
            yield {"who": peer} | dict.fromkeys(columns, "–") | {"": found}
            continue
        versions[peer] = found["version"]
        many = None if peer == "VAMP" else found["batch"]
        yield row(peer, found["single"], many, np.array(found["free"]))


def _fingers(urdf: Path) -> dict[str, bool]:
    """Joints of the file that slide, and whether they follow no other: pinocchio's reader takes all by themselves."""
    from kinseek.robots.xml_files import root_element

    joints = root_element(urdf.read_bytes(), str(urdf)).findall("joint")
    return {j.get("name"): j.find("mimic") is None for j in joints if j.get("type") == "prismatic"}


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__,
        __doc__,
        arms=ARMS,
        page="collisions.md",
        checks=(5000, 200, "joint values to check"),
        proofs=(1_000_000, 2_000, "verdicts to compare"),
        targets=(1000, 20, "targets an arm"),
        motions=(1000, 20, "motions called free, an arm"),
        points=(10_000, 500, "points of a motion"),
    )
    parser.add_argument("--urdf", type=Path, help="a file with collision meshes")
    parser.add_argument("--tip", help="its last link")
    parser.add_argument("--meshes", type=Path, nargs="*", default=[], help="folders of its packages")
    parser.add_argument(
        "--srdf", type=Path, help="pairs that do not count beside VAMP, which has some of its own"
    )
    options = parser.options()
    page = Page("Scenes", "benchmarks.collisions")
    if options.urdf:
        checks(page, options)
        proofs(page, options)
        beside(page, options)
    page.head("Solutions in a shelf")
    page.say(
        "Targets are poses of random joint values at which the arm is free. *Cut a board* counts solutions in which the",
        "line through the joints comes nearer to a board than the capsules are thick.",
    )
    page.rows(answers(name, options.targets) for name in options.arms)
    page.head("Motions that are reported as free")
    page.say(
        f"MuJoCo checks {options.points:,} points of each motion that `scene.free_motion` reports as free."
    )
    page.rows(motions(name, options.motions, options.points) for name in options.arms)
    page.end(options)


if __name__ == "__main__":
    main()
