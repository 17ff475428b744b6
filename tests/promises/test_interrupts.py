"""Ctrl-C: heard within half a second at any moment, never a crash, and the arm works on."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from importlib import import_module
from pkgutil import walk_packages
from typing import Any, NamedTuple, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from numba.core.dispatcher import Dispatcher
from numba.core.types import Array as ArrayType
from numba.core.types import BaseTuple

import kinseek
from fuzz.interrupts import CALLS, outside
from kinseek import maps
from kinseek.collision import Mesh
from kinseek.kernels.arrays import Array
from kinseek.kernels.entry import ENTRIES

pytestmark = [pytest.mark.slow, pytest.mark.thorough]

MOMENTS = 4
"""Of each call; `python -m tests.fuzz.interrupts` tries more."""


def kernels() -> Iterator[tuple[str, Any]]:
    """Every kernel that Python can call."""
    for module in walk_packages(kinseek.__path__, "kinseek."):
        if module.name.endswith("__main__"):
            continue
        for name, value in vars(import_module(module.name)).items():
            ours = isinstance(value, Dispatcher) and value.__module__ == module.name
            if ours and not value.targetoptions.get("no_cpython_wrapper"):
                yield f"{module.name}.{name}", value


def hands_back_a_bundle(annotation: Any, inside: bool = False) -> bool:
    """Is it a NamedTuple, or a tuple with an array in it?"""
    if isinstance(annotation, type) and issubclass(annotation, tuple) and hasattr(annotation, "_fields"):
        return True
    if get_origin(annotation) is tuple:
        return any(hands_back_a_bundle(part, inside=True) for part in get_args(annotation))
    return inside and (get_origin(annotation) is np.ndarray or annotation is np.ndarray)


class Bundle(NamedTuple):
    """To see whether one is seen."""

    one: float


@pytest.mark.parametrize(
    ("annotation", "bundle"),
    [
        (Bundle, True),
        (tuple[int, Array], True),
        (tuple[Bundle, int], True),
        (tuple[int, float], False),
        (Array, False),
    ],
)
def test_bundles_are_seen(annotation: Any, bundle: bool) -> None:
    assert hands_back_a_bundle(annotation) == bundle


def test_no_kernel_hands_a_bundle_back_to_python() -> None:
    """To make one, Numba calls its class: a signal handler that raises there kills the process."""
    seen = {name: kernel.py_func for name, kernel in kernels()}  # None, if they run from the library.
    seen |= {name: entry.function for name, entry in ENTRIES.items()}
    assert len(seen) > 30
    bundles = [
        name for name, function in seen.items() if hands_back_a_bundle(get_type_hints(function)["return"])
    ]
    assert bundles == []


def test_nor_does_what_is_compiled() -> None:
    """What is annotated is what is handed back."""
    arm = kinseek.load("planar2")
    T = arm.fk(arm.lower)
    for solver in kinseek.ALL_SOLVERS:
        arm.ik(T, solver=kinseek.BruteForce(4) if solver is kinseek.BruteForce else solver())
    for name, kernel in kernels():
        for signature in kernel.nopython_signatures:
            handed: Any = signature.return_type
            if issubclass(type(handed), BaseTuple):
                assert not hasattr(handed, "fields"), name
                assert not any(isinstance(part, ArrayType | BaseTuple) for part in handed), name


@pytest.fixture(name="reports", scope="module")
def _reports() -> dict[str, dict[str, Any]]:
    """All calls in one process, for it takes seconds to start; after a crash the rest in another."""
    return outside(list(CALLS), MOMENTS, seed=1)


@pytest.mark.parametrize("name", CALLS)
def test_ctrl_c_is_heard_and_the_arm_works_on(reports: dict[str, dict[str, Any]], name: str) -> None:
    assert reports[name]["wrong"] == []
    assert reports[name]["heard"] == MOMENTS


def many(arm: kinseek.Arm, count: int) -> np.ndarray:
    """The same pose many times, in no more memory than one."""
    return np.broadcast_to(arm.fk(arm.sample(1))[0], (count, 4, 4))


def two_circles(corners: int) -> Mesh:
    """A hull for which Qhull takes a time that grows with the square of its corners."""
    t = np.linspace(0.0, 2.0 * np.pi, corners // 2, endpoint=False)
    circle = np.stack([np.cos(t), np.sin(t), np.zeros_like(t)], axis=1)
    faces = np.arange(corners // 3 * 3).reshape(-1, 3)
    return Mesh(np.concatenate([circle, circle + np.eye(3)[2]]), faces, hull=True)


def on_a_map(arm: kinseek.Arm) -> Callable[[], Any]:
    cells = (-1.0, 1.0, 0.5)
    found = maps.reach(arm, maps.Grid(cells, cells, cells, maps.orientations(72)))
    T = many(arm, 3_000_000)
    return lambda: maps.at(found, T)


LARGE: dict[str, Callable[[kinseek.Arm], Callable[[], Any]]] = {
    "fk": lambda arm: partial(arm.fk, np.broadcast_to(np.ones(6), (10_000_000, 6))),
    "manipulability": lambda arm: partial(arm.manipulability, np.broadcast_to(np.zeros(6), (1_000_000, 6))),
    "sample": lambda arm: partial(arm.sample, 20_000_000),
    "pose": lambda arm: partial(
        kinseek.pose, np.zeros(3), rpy=np.broadcast_to([0.1, 0.2, 0.3], (12_000_000, 3))
    ),
    "maps.at": on_a_map,
    "hull": lambda arm: two_circles(8_000).geometry,
}
"""Calls that would take seconds of processor time."""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers that interrupt")
@pytest.mark.parametrize("name", LARGE)
def test_calls_on_very_long_arrays_are_interrupted(name: str) -> None:
    """After some processor time, and measured in it: other programs on a busy machine take none of it."""
    if name == "hull":
        pytest.importorskip("coal")
    if name == "maps.at":
        pytest.importorskip("xarray")
    call = LARGE[name](kinseek.load("ur5e"))
    handler = signal.signal(signal.SIGPROF, signal.default_int_handler)
    try:
        for moment in (0.1, 0.3, 0.5):
            began = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, moment)
            with pytest.raises(KeyboardInterrupt):
                call()
            assert time.process_time() - began < moment + 0.5
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, handler)


LOADING = """
import os, signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # A job in the background begins without it.
from numba.core import codegen
given, seen = codegen.CPUCodeLibrary.__dict__["_object_getbuffer_hook"].__func__, []
def hook(cls, module):
    seen.append(module)
    if len(seen) == {moment}:
        os.kill(os.getpid(), signal.SIGINT)
    return given(cls, module)
codegen.CPUCodeLibrary._object_getbuffer_hook = classmethod(hook)
import numpy as np
import kinseek
arm = kinseek.load("planar2")
T = np.diag([1.0, -1.0, -1.0, 1.0])
T[0, 3] = 1.0
try:
    arm.ik(T)
    print("not heard", len(seen))
except KeyboardInterrupt:
    print("heard", end=" ")
print(arm.ik(T).q.tobytes().hex())
"""
"""SIGINT at the very moment in which LLVM asks Numba for a kernel's machine code."""


@pytest.mark.jit
def test_ctrl_c_while_a_kernel_is_read_from_disk() -> None:
    def run(moment: int) -> str:
        code = LOADING.format(moment=moment)
        ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert ended.returncode == 0, ended.stderr
        return ended.stdout

    loads = int(run(0).split()[2])
    never = run(0).split()[-1]
    assert loads > 1
    for moment in (1, loads):
        assert run(moment).split()[-2:] == ["heard", never]
