"""ssik: every answer of arms with six and seven revolute joints, by algebra that is specialised to the arm.

https://pypi.org/project/ssik: `Manipulator.from_urdf(path).solve(T)`, of which the first is taken. In the sweep one
answer is asked for, and the artifact that `ssik build` writes for an arm, which its manual calls the way to a new
robot; building takes seconds for most arms and minutes for some. It is given twenty seconds, once in an environment, else
the arm is left to the first way.
"""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.field.protocol import Answer, Arm, Array, Refused

NAME = "ssik"
PACKAGE = "ssik"
RECOMMENDED: dict[str, Any] = {"built": False, "max_solutions": None, "enumerate_windings": True}
SWEEP: tuple[dict[str, Any], ...] = (
    {"built": False, "max_solutions": 1, "enumerate_windings": False},
    {"built": True, "max_solutions": 1, "enumerate_windings": False},
)
BUILD = 20.0
"""[s]"""


class _Solver:
    def __init__(self, solve: Any, settings: dict[str, Any]) -> None:
        self._solve = solve
        self._set = {name: value for name, value in settings.items() if name != "built"}

    def solve(self, T: Any, start: Any) -> Answer:
        near = {} if start is None else {"q_seed": np.asarray(start, dtype=float)}
        found = self._solve(T, **self._set, **near)
        return Answer(found[0].q, True) if len(found) else Answer(None, False)

    def branches(self, T: Array) -> Sequence[Array]:
        return [each.q for each in self._solve(T, enumerate_windings=self._set["enumerate_windings"])]


def _built(arm: Arm) -> Any:
    """The artifact's function; built in the solver's environment, once."""
    path = Path(sys.prefix) / "ssik-built" / f"{arm.name}_ssik.py"
    tried = path.with_suffix(".tried")
    if not path.is_file():
        if tried.is_file():
            return None
        path.parent.mkdir(exist_ok=True)
        made = path.with_suffix(".unfinished.py")
        build = "import sys; from ssik.cli import main; sys.exit(main())"
        told = ["build", arm.urdf, "--no-validate", "--base", arm.base, "--ee", arm.tip, "--out", str(made)]
        try:
            subprocess.run(
                [sys.executable, "-c", build, *told], capture_output=True, timeout=BUILD, check=True
            )
        except (subprocess.TimeoutExpired, subprocess.CalledProcessError):
            tried.touch()
            return None
        made.replace(path)
    specification = importlib.util.spec_from_file_location(path.stem, path)
    if specification is None or specification.loader is None:
        return None
    module = importlib.util.module_from_spec(specification)
    sys.modules[path.stem] = module
    specification.loader.exec_module(module)
    return module.solve


def load(arm: Arm, settings: dict[str, Any]) -> _Solver:
    """From the file."""
    if set(arm.kinds) - {"revolute", "continuous"} or arm.follows or len(arm.joints) not in (6, 7):
        raise Refused("six or seven revolute joints only")
    from ssik import Manipulator

    solve = _built(arm) if settings["built"] else None
    return _Solver(solve or Manipulator.from_urdf(arm.urdf, base=arm.base, ee=arm.tip).solve, settings)
