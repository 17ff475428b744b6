"""One peer on one arm, in its own environment: reads targets, writes answers and the time of every call.

Imports NumPy and the peer, nothing of kinseek. Settings are the best that were found: restarts on, tolerances brought to
1e-6, limits on. A peer is never seeded from the answer; one that wants a start gets the middle of the ranges.

    python worker.py PEER INPUT.npz OUTPUT.npz
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

Solve = Callable[[Any], Any]
"""A (4, 4) target to joint values, (n,), or None."""

DISTRIBUTIONS = {
    "EAIK": "EAIK",
    "ssik": "ssik",
    "OptIK": "optik-py",
    "TRAC-IK": "pytracik",
    "Robotics Toolbox": "roboticstoolbox-python",
    "pinocchio loop": "pin",
}


def eaik(arm: Any) -> Solve:
    """Every branch in closed form, then the first inside the limits; exact ones before least-squares ones."""
    module = importlib.import_module("eaik.IK_HP")

    if len(arm["lower"]) != 6:
        raise RuntimeError("six joints only")
    robot = module.HPRobot(arm["axes"], arm["offsets"])
    if not robot.hasKnownDecomposition():
        raise RuntimeError("no closed form known")
    lower, upper, turn = arm["lower"] - 1e-9, arm["upper"] + 1e-9, arm["turn"]
    middle = (lower + upper) / 2
    two_pi = 2 * np.pi

    def solve(T: Any) -> Any:
        turned = T.copy()
        turned[:3, :3] = T[:3, :3] @ turn
        found = robot.IK(turned)
        q = np.asarray(found.Q)
        if not len(q):
            return None
        q = middle + (q - middle + np.pi) % two_pi - np.pi
        inside = ((q >= lower) & (q <= upper)).all(axis=1)
        exact = inside & ~np.asarray(found.is_LS, dtype=bool)
        first = int((exact if exact.any() else inside).argmax())
        return q[first] if inside[first] else None

    return solve


def ssik_artifact(arm: Any) -> Any:
    """The module that ``ssik build`` writes for an arm."""
    folder = Path(str(arm["folder"]))
    path = folder / f"{arm['name']}_ssik.py"
    if len(arm["lower"]) != 6:
        raise RuntimeError("built for six joints only here")
    if not path.is_file():
        command = [str(Path(sys.executable).with_name("ssik")), "build", str(arm["urdf"]), "--no-validate"]
        links = ["--base", str(arm["base"]), "--ee", str(arm["tip"]), "--out", str(path)]
        done = subprocess.run([*command, *links], capture_output=True, text=True, timeout=180, check=False)
        if done.returncode or not path.is_file():
            raise RuntimeError(f"artifact did not build: {done.stderr.strip().splitlines()[-1:]}")
    specification = importlib.util.spec_from_file_location(path.stem, path)
    if specification is None or specification.loader is None:
        raise RuntimeError(f"cannot import {path.name}")
    artifact = importlib.util.module_from_spec(specification)
    sys.modules[path.stem] = artifact
    specification.loader.exec_module(artifact)
    return artifact


def ssik(arm: Any) -> Solve:
    """The artifact that ``ssik build`` writes for an arm, asked for one answer."""
    artifact = ssik_artifact(arm)

    def solve(T: Any) -> Any:
        found = artifact.solve(T, max_solutions=1, enumerate_windings=False)
        return found[0].q if found else None

    return solve


def optik(arm: Any) -> Solve:
    """Random restarts of an SQP solver, one thread."""
    module = importlib.import_module("optik")

    robot = module.Robot.from_urdf_file(str(arm["urdf"]), str(arm["base"]), str(arm["tip"]))
    robot.set_parallelism(1)
    config, start = (
        module.SolverConfig("speed", max_time=0.1, tol_f=2.5e-13),
        (arm["lower"] + arm["upper"]) / 2,
    )

    def solve(T: Any) -> Any:
        found = robot.ik(config, T, start)
        return None if found is None else found[0]

    return solve


def trac_ik(arm: Any) -> Solve:
    """KDL with restarts beside an SQP solver."""
    module = importlib.import_module("trac_ik")

    solver = module.TracIK(str(arm["base"]), str(arm["tip"]), str(arm["urdf"]), timeout=0.05, epsilon=5e-7)
    start = (arm["lower"] + arm["upper"]) / 2

    def solve(T: Any) -> Any:
        return solver.ik(T[:3, 3], T[:3, :3], start)

    return solve


def robotics_toolbox(arm: Any) -> Solve:
    """Levenberg-Marquardt in C++ with restarts, tuned: by default its tolerance is on the squared error."""
    module = importlib.import_module("roboticstoolbox")

    ets, start = elementary(module, arm), (arm["lower"] + arm["upper"]) / 2

    def solve(T: Any) -> Any:
        found = ets.ik_LM(
            T, q0=start, method="chan", k=0.1, tol=1e-13, ilimit=30, slimit=100, joint_limits=True
        )
        return found[0]

    return solve


def pinocchio_loop(arm: Any) -> Solve:
    """The loop of pinocchio's manual, with clamping and up to 100 random restarts."""
    import pinocchio as pin

    model = reduced(pin, arm)
    if model.nq != len(arm["lower"]):
        raise RuntimeError("continuous joints are two numbers in pinocchio: left out")
    data, frame, base = (
        model.createData(),
        model.getFrameId(str(arm["tip"])),
        model.getFrameId(str(arm["base"])),
    )
    pin.framesForwardKinematics(model, data, pin.neutral(model))
    root, lower, upper = data.oMf[base].copy(), arm["lower"], arm["upper"]
    rng = np.random.default_rng(0)

    def solve(T: Any) -> Any:
        target, q = root * pin.SE3(T), (lower + upper) / 2
        for _ in range(100):
            for _ in range(100):
                pin.framesForwardKinematics(model, data, q)
                error = data.oMf[frame].actInv(target)
                twist = pin.log6(error).vector
                if np.linalg.norm(twist[:3]) < 5e-7 and np.linalg.norm(twist[3:]) < 5e-7:
                    return q
                J = pin.computeFrameJacobian(model, data, q, frame)
                J = pin.Jlog6(error.inverse()) @ J
                step = J.T @ np.linalg.solve(J @ J.T + 1e-6 * np.eye(6), twist)
                q = np.clip(q + step, lower, upper)
            q = rng.uniform(lower, upper)
        return None

    return solve


def elementary(module: Any, arm: Any) -> Any:
    """An arm as the elementary transforms of the Robotics Toolbox."""
    chain, lower, upper = [], arm["lower"], arm["upper"]
    for i, A in enumerate(arm["fixed"]):
        chain.append(module.ET.SE3(np.vstack([A, [0.0, 0.0, 0.0, 1.0]])))
        if i < len(lower):
            chain.append(module.ET.Rz(qlim=np.array([lower[i], upper[i]])))
    return module.ETS(chain)


def reduced(pin: Any, arm: Any) -> Any:
    """A model of pinocchio with the joints of the arm alone."""
    model = pin.buildModelFromUrdf(str(arm["urdf"]))
    others = [joint for joint in model.names[1:] if joint not in set(arm["joints"].tolist())]
    locked = [model.getJointId(joint) for joint in others]
    return pin.buildReducedModel(model, locked, pin.neutral(model))


PEERS: dict[str, Callable[[Any], Solve]] = {
    "EAIK": eaik,
    "ssik": ssik,
    "OptIK": optik,
    "TRAC-IK": trac_ik,
    "Robotics Toolbox": robotics_toolbox,
    "pinocchio loop": pinocchio_loop,
}


def limit_memory(gigabytes: int) -> None:
    """Keep a peer that runs away from taking the machine with it."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (gigabytes << 30, gigabytes << 30))


def arguments(doc: str | None, peers: Iterable[str]) -> tuple[str, str, str]:
    """The peer, the file of targets and the file of answers, from the command line."""
    parser = argparse.ArgumentParser(description=doc, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("peer", choices=list(peers), metavar="PEER", help=", ".join(peers))
    parser.add_argument("input", metavar="INPUT.npz", help="the arm and its targets")
    parser.add_argument("output", metavar="OUTPUT.npz", help="where answers and times go")
    options = parser.parse_args()
    return options.peer, options.input, options.output


def work(
    doc: str | None, peers: dict[str, Callable[[Any], Any]], warm: int, read: Callable[[Any], tuple[Any, int]]
) -> None:
    """Ask a peer for every target once, after some to warm up; write answers, what it says of them, and times [µs].

    Args:
        doc: What `--help` prints.
        peers: What makes, of an arm, the function that is asked and timed.
        warm: Targets to warm up with.
        read: Makes of what that function hands back joint values or None, and what the peer says of them.
    """
    name, source, destination = arguments(doc, peers)
    limit_memory(8)
    arm = dict(np.load(source, allow_pickle=False))
    solve, targets = peers[name](arm), arm["targets"]
    for T in targets[:warm]:
        solve(T)
    answers, times = np.full((len(targets), len(arm["lower"])), np.nan), np.empty(len(targets))
    said = np.zeros(len(targets), dtype=int)
    for i, T in enumerate(targets):
        began = time.perf_counter_ns()
        found = solve(T)
        times[i] = (time.perf_counter_ns() - began) / 1e3
        q, said[i] = read(found)
        if q is not None:
            answers[i] = q
    np.savez(destination, q=answers, said=said, times=times, version=version(DISTRIBUTIONS[name]))


def main() -> None:
    """Ask for one answer a target; nothing is said of it."""
    work(__doc__, PEERS, 20, lambda q: (q, 0))


if __name__ == "__main__":
    main()
