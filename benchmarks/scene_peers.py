"""Scenes beside VAMP and PyRoki: the Panda with itself and twenty capsules, the obstacles that all of them support.

Each peer has its own model of the arm, and is compared with coal on the hulls of the collision meshes. A *false alarm* is
free for coal and touching for the peer; a *miss* is touching for coal and free for the peer. Either may come from another
shape of the arm and not from an error of the peer, but a user gets this verdict. Part of `benchmarks.collisions`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from kinseek.collision import Capsule

from .field.adapters import path_of
from .page import Page
from .workers.process import called, releases
from .workers.scenes import CHECKERS

HERE = Path(__file__).resolve().parent / "workers"

Array = NDArray[np.float64]

FINGERS = 0.04
"""How far the fingers are open [m]."""

SECONDS = 600
"""For one peer."""


def capsules(count: int = 20) -> list[tuple[Capsule, Array]]:
    """Capsules around an arm, and their poses."""
    rng, found = np.random.default_rng(1), []
    for _ in range(count):
        shape = Capsule(rng.uniform(0.03, 0.08), rng.uniform(0.05, 0.3))
        found.append((shape, kinseek.pose(rng.uniform(-1, 1, 3), rpy=rng.uniform(-3, 3, 3))))
    return found


def described(
    scene: kinseek.Scene, arm: kinseek.Arm, options: Any, obstacles: Any, q: Array
) -> dict[str, Any]:
    """What a peer may need to know of a scene."""
    half = np.array([[0.0, 0.0, shape.length / 2] for shape, _ in obstacles])
    turned = np.array([pose[:3, :3] @ side for (_, pose), side in zip(obstacles, half, strict=True)])
    middles = np.array([pose[:3, 3] for _, pose in obstacles])
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
        "radii": np.array([shape.radius for shape, _ in obstacles]),
        "ignored": ignored,
        "q": q,
    }


def beside(page: Page, options: Any, by_hand: Any, best: Any) -> None:
    """Ask kinseek, coal by hand and the peers about the same joint values.

    Args:
        page: To write on.
        options: Of `benchmarks.collisions`.
        by_hand: Makes the check that a user of pinocchio writes.
        best: Least time of some runs.
    """
    arm, obstacles = kinseek.load(options.urdf, tip=options.tip), capsules()
    fingers = _fingers(options.urdf)
    joints = {name: FINGERS for name, leads in fingers.items() if leads}
    scene = kinseek.Scene.of(arm, meshes=options.meshes, srdf=options.srdf, joints=joints)
    for number, (shape, pose) in enumerate(obstacles):
        scene.add(f"capsule{number}", shape, pose)
    q = arm.sample(options.checks, seed=5)
    hand = by_hand(
        scene,
        options.urdf,
        arm,
        [str(folder) for folder in options.meshes],
        obstacles,
        dict.fromkeys(fingers, FINGERS),
    )
    truth = np.array([hand(each) for each in q])
    few = q[: max(len(q) // 10, 1)]
    rows = [
        _row(
            "pinocchio and coal by hand",
            best(lambda: [hand(each) for each in few]) / len(few) * 1e6,
            None,
            truth,
            truth,
        ),
        _row(
            "kinseek, `scene.free(q)`",
            best(lambda: [scene.free(each) for each in few]) / len(few) * 1e6,
            best(lambda: scene.free(q, threads=1)) / len(q) * 1e6,
            scene.free(q),
            truth,
        ),
    ]
    versions = {}
    known = described(scene, arm, options, obstacles, q)
    for peer, (place, _, _) in CHECKERS.items():
        requirements = HERE / place if place == "vamp" else path_of(place)
        found = called(requirements, "benchmarks.workers.scenes", "check", SECONDS, peer=peer, scene=known)
        if isinstance(found, str):
            rows.append((peer, "–", "–", "–", "–", found))
            continue
        versions[peer] = found["version"]
        batch = None if peer == "VAMP" else found["batch"]
        rows.append(_row(peer, found["single"], batch, np.array(found["free"]), truth))
    page.head(f"Beside VAMP and PyRoki: {arm.name} with itself and twenty capsules")
    page.say(
        f"{len(q):,} random joint values, {truth.mean():.0%} of them free according to coal; one thread. "
        f"{releases(versions)}"
    )
    page.say(
        "From Python, VAMP takes one q and the environment with each call; only its own planner checks eight q at a time.",
        "PyRoki comes from a commit of its repository and is compiled by JAX for one core; it is made for a GPU. A false",
        "alarm is a free q that is reported as colliding, a miss is a colliding q that is reported as free, both compared",
        "with coal.",
    )
    page.table("who | >µs one by one | >µs of a batch | >false alarms | >misses | ", rows)


def _row(who: str, single: float, batch: float | None, free: Any, truth: Any) -> tuple[str, ...]:
    alarms, misses = (truth & ~free).mean(), (free & ~truth).mean()
    times = [f"{single:.1f}", "–" if batch is None else f"{batch:.2f}"]
    return (who, *times, f"{alarms:.2%}", f"{misses:.2%}", "")


def _fingers(urdf: Path) -> dict[str, bool]:
    """Joints of the file that slide, and whether they follow no other: pinocchio's reader takes all by themselves."""
    from kinseek.robots.xml_files import root_element

    joints = root_element(urdf.read_bytes(), str(urdf)).findall("joint")
    return {j.get("name"): j.find("mimic") is None for j in joints if j.get("type") == "prismatic"}
