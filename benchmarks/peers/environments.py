"""The peers: their environments, what they are told of an arm, and how one is asked."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import kinseek
from benchmarks.targets import ROBOTS
from kinseek.robots import catalog_entry
from kinseek.robots.catalog import catalog_path

Array = NDArray[np.float64]

HERE = Path(__file__).resolve().parent
VENVS = HERE / ".venvs"

ENVIRONMENTS = {
    "optik": ("optik-py", "numpy"),
    "differential": ("pin-pink", "mink", "qpsolvers[daqp]"),
    "placo": ("placo",),
    "drake": ("drake",),
    "tesseract": ("tesseract-robotics", "numpy"),
    "vamp": ("vamp-planner", "numpy"),
    "pyroki": ("pyroki @ git+https://github.com/chungmin99/pyroki.git", "numpy"),
    "shared": ("pin", "EAIK", "ssik", "pytracik", "roboticstoolbox-python"),
}
"""Wheels that share an environment; the others want one each."""

PEERS = {
    "EAIK": ("shared", 2.0),
    "ssik": ("shared", 1.5),
    "Robotics Toolbox": ("shared", 4.0),
    "OptIK": ("optik", 12.0),
    "TRAC-IK": ("shared", 30.0),
    "pinocchio loop": ("shared", None),
}
"""Environment, and how many times faster than it kinseek means to be."""


def environment(name: str) -> Path | None:
    """Python of an environment, made if it is not there; None where that fails."""
    folder = VENVS / name
    python = folder / ("Scripts/python.exe" if os.name == "nt" else "bin/python")
    if (folder / "ready").is_file():
        return python
    print(f"making {folder.name}: {', '.join(ENVIRONMENTS[name])}", flush=True)
    try:
        subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
        subprocess.run(
            [str(python), "-m", "pip", "install", "--quiet", *ENVIRONMENTS[name]], check=True, timeout=900
        )
    except (subprocess.SubprocessError, OSError) as error:
        print(f"  cannot: {error}")
        return None
    (folder / "ready").touch()
    return python


def write_arm(
    name: str, arm: kinseek.Arm, targets: Array, path: Path, more: dict[str, Any] | None = None
) -> None:
    """Write down what a peer may need to know of an arm, the targets, and what more a worker asks for."""
    chain, n = arm.chain, arm.dof
    square = np.concatenate([chain.fixed, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (n + 1, 1, 1))], axis=1)
    frames = [np.eye(4)]
    for A in square:
        frames.append(frames[-1] @ A)
    points = np.array([frame[:3, 3] for frame in frames])
    urdf = ROBOTS / f"{name}.urdf"
    np.savez(
        path,
        name=name,
        urdf=str(urdf if urdf.is_file() else catalog_path(name)),
        base=catalog_entry(name).base,
        tip=catalog_entry(name).tip,
        joints=np.array(arm.joint_names),
        folder=str(VENVS),
        lower=arm.lower,
        upper=arm.upper,
        fixed=chain.fixed,
        axes=np.array([frame[:3, 2] for frame in frames[1 : n + 1]]),
        offsets=np.diff(points, axis=0),
        turn=frames[-1][:3, :3].T,
        targets=targets,
        **(more or {}),
    )


def ask(worker: str, peer: str, python: Path, source: Path, seconds: int) -> dict[str, Any] | str:
    """Run a peer in its environment; what it hands back, or why there is nothing.

    Args:
        worker: File beside this one that the environment runs.
        peer: Name.
        python: Of the environment.
        source: What `write_arm` wrote.
        seconds: After so many it is stopped.
    """
    one = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as folder:
        destination = Path(folder) / "answers.npz"
        command = [str(python), str(HERE / worker), peer, str(source), str(destination)]
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, timeout=seconds, env=os.environ | one, check=False
            )
        except subprocess.TimeoutExpired:
            return f"stopped after {seconds} s"
        if done.returncode or not destination.is_file():
            lines = [line for line in done.stderr.strip().splitlines() if line.strip()]
            reason = lines[-1].removeprefix("RuntimeError: ") if lines else f"ended with {done.returncode}"
            return reason[:60]
        with np.load(destination) as found:
            return {key: found[key] for key in found}


def releases(versions: dict[str, str]) -> str:
    """One sentence of the peers that answered, and their versions."""
    return f"Peers: {', '.join(f'{peer} {release}' for peer, release in versions.items() if release)}."
