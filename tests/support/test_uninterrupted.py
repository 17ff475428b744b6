"""Work that Ctrl-C does not tear: what it gives, what it raises, and what is stopped and waited for."""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import maps
from kinseek.support.interrupts import chunks, in_chunks, raise_of_handler, uninterrupted
from kinseek.support.validation import arrays_equal


def test_it_gives_what_the_work_gives_in_a_thread_of_its_own() -> None:
    thread = uninterrupted(threading.current_thread)
    assert thread is not threading.main_thread()


def test_it_raises_what_the_work_raises() -> None:
    with pytest.raises(ZeroDivisionError):
        uninterrupted(lambda: 1 // 0)


def test_who_waits_hears_that_there_are_no_more_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    def start(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(RuntimeError, match="can't start"):
        uninterrupted(lambda: 1)


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers that interrupt")
def test_an_interrupt_stops_the_work_and_waits_for_its_end() -> None:
    stopped, ended = threading.Event(), threading.Event()

    def work() -> None:
        stopped.wait(10.0)
        time.sleep(0.02)
        ended.set()

    handler = signal.signal(signal.SIGALRM, signal.default_int_handler)
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.05)
        with pytest.raises(KeyboardInterrupt):
            uninterrupted(work, stop=stopped.set)
    finally:
        signal.signal(signal.SIGALRM, handler)
    assert ended.is_set()


@pytest.mark.parametrize(("count", "expected"), [(0, [(0, 0)]), (3, [(0, 3)]), (7, [(0, 3), (3, 6), (6, 7)])])
def test_chunks_hold_every_row_once(count: int, expected: list[tuple[int, int]]) -> None:
    assert [(part.start, part.stop) for part in chunks(count, 3)] == expected


def test_what_is_done_in_chunks_is_what_is_done_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("kinseek.support.interrupts.CHUNK", 4)
    sizes = list[int]()

    def work(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        sizes.append(len(a))
        return np.asarray(a[:, None] + b)

    a, b = np.arange(11), np.arange(22.0).reshape(11, 2)
    np.testing.assert_array_equal(in_chunks(work, a, b), a[:, None] + b)
    assert sizes == [4, 4, 3]
    assert in_chunks(work, a[:0], b[:0]).shape == (0, 2)


def of_many_rows(arm: kinseek.Arm, map_of_rings: Any) -> Iterator[np.ndarray]:
    """What calls give that work in chunks."""
    q = arm.sample(50, seed=3)
    yield q
    T = arm.fk(q)
    yield from (T, arm.fk(q, link=arm.tip), arm.jacobian(q), arm.manipulability(q))
    yield arm.manipulability(q.reshape(5, 10, arm.dof))
    rng = np.random.default_rng(1)
    place, wxyz, angles = (
        rng.uniform(-1.0, 1.0, (50, 3)),
        rng.normal(size=(50, 4)),
        rng.uniform(-3.0, 3.0, (50, 3)),
    )
    yield kinseek.pose(place, quat_wxyz=wxyz)
    yield kinseek.pose(place, quat_xyzw=wxyz)
    yield kinseek.pose(place, rotvec=angles)
    yield kinseek.pose(place[:5].reshape(5, 1, 3), rpy=angles[:7].reshape(1, 7, 3))
    off = T.copy()
    off[::3, :3, :3] += 1e-8 * rng.normal(size=(17, 3, 3))
    yield kinseek.Goal.pose(off).target
    solution = arm.ik(T)
    yield from (solution.q, solution.position_error, solution.weighted_error)
    yield from maps.at(map_of_rings, T.reshape(5, 10, 4, 4)).values()


@pytest.mark.slow
def test_chunks_change_no_bits(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xarray")
    arm = kinseek.load("ur5e")
    rings = maps.Rings((0.0, 1.0, 0.25), (-1.0, 1.0, 0.25), maps.orientations(72))
    found = maps.reach(arm, rings)
    whole = list(of_many_rows(arm, found))
    for module in ("support.interrupts", "poses"):
        monkeypatch.setattr(f"kinseek.{module}.CHUNK", 7)
    monkeypatch.setattr("kinseek.support.validation._NUMBERS", 7)
    parts = list(of_many_rows(arm, found))
    assert len(whole) == len(parts) > 15
    for one, other in zip(whole, parts, strict=True):
        assert one.shape == other.shape
        assert one.dtype == other.dtype
        assert one.tobytes() == other.tobytes()


def test_poses_that_are_none_are_named_in_long_batches(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("support.interrupts", "poses"):
        monkeypatch.setattr(f"kinseek.{module}.CHUNK", 7)
    T = np.tile(np.eye(4), (20, 1, 1))
    T[17, 0, 0] = 2.0
    with pytest.raises(kinseek.InvalidGoal, match="at index 17 of the batch"):
        kinseek.Goal.pose(T)
    T[17, 0, 0] = np.nan
    with pytest.raises(kinseek.InvalidGoal, match=r"NaN or infinity at index 17 of the batch \(1 such"):
        kinseek.Goal.pose(T)
    place = np.zeros((20, 3))
    place[19] = np.inf
    with pytest.raises(kinseek.InvalidGoal, match="position contains NaN or infinity"):
        kinseek.pose(place)
    q = np.zeros((20, 2))
    q[13, 1] = np.nan
    monkeypatch.setattr("kinseek.problem.FEW", 4)
    monkeypatch.setattr("kinseek.problem.SQUARED", 7)
    with pytest.raises(kinseek.InvalidProblem, match=r"index \(13, 1\)"):
        kinseek.load("planar2").fk(q)


class Late(Exception):
    """What a handler raises in these tests."""


def raise_late(number: int, frame: Any) -> None:
    """A handler."""
    raise Late


def interrupt(*given: Any, **_: Any) -> Any:
    """Let the signal come right here."""
    signal.raise_signal(signal.SIGALRM)


@pytest.fixture
def _handled() -> Iterator[None]:
    before = signal.signal(signal.SIGALRM, raise_late)
    yield
    signal.signal(signal.SIGALRM, before)


def poses(call: Callable[[], Any], good: int) -> Iterator[Any]:
    """Some poses, then what a call gives."""
    T = np.eye(4)
    yield from [T] * good
    yield call()


INTERRUPTED: dict[str, Callable[[kinseek.Arm, Any, Path], Any]] = {
    "valid": lambda arm, T, tmp: arm.ik(T, valid=interrupt),
    "cost": lambda arm, T, tmp: arm.ik(T, cost=interrupt),
    "poses of a path": lambda arm, T, tmp: arm.follow(poses(interrupt, 2)),
    "poses of a stream": lambda arm, T, tmp: list(arm.follow_stream(poses(interrupt, 2))),
    "kinematics": lambda arm, T, tmp: kinseek.Arm.from_fk(interrupt, [-1.0], [1.0]),
    "kinematics of one row": lambda arm, T, tmp: kinseek.Arm.from_fk(
        interrupt, [-1.0], [1.0], vectorized=False
    ),
}


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no such signal")
@pytest.mark.usefixtures("_handled")
@pytest.mark.parametrize("name", INTERRUPTED)
def test_what_a_handler_raises_reaches_the_caller(name: str, tmp_path: Path) -> None:
    """And no error about the function in which the signal came."""
    arm = kinseek.load("planar2")
    with pytest.raises(Late):
        INTERRUPTED[name](arm, arm.fk([0.3, 0.4]), tmp_path)


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no such signal")
@pytest.mark.usefixtures("_handled")
def test_a_handler_may_raise_while_xacro_works(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("xacrodoc")
    from xacrodoc.xacrodoc import xacro

    path = tmp_path / "r.xacro"
    path.write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="${1 + 1}"/></robot>', "utf-8"
    )
    monkeypatch.setattr(xacro, "safe_eval", interrupt)
    with pytest.raises(Late):
        kinseek.load(path)


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no such signal")
@pytest.mark.usefixtures("_handled")
def test_a_handler_may_raise_while_yaml_is_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "limits.yaml"
    path.write_text("joint_limits: {}\n", "utf-8")
    monkeypatch.setattr("kinseek.robots.yaml_files.yaml_content", interrupt)
    with pytest.raises(Late):
        kinseek.load("planar2", limits=path)


@pytest.mark.skipif(not hasattr(signal, "SIGALRM"), reason="no such signal")
@pytest.mark.usefixtures("_handled")
def test_an_error_that_follows_what_a_handler_raised_is_another_one() -> None:
    def wrong(q: Any) -> Any:
        raise ValueError("of the function")

    try:
        interrupt()
    except Late:
        with pytest.raises(kinseek.FailedKinematics, match="of the function"):
            kinseek.Arm.from_fk(wrong, [-1.0], [1.0])


def test_other_errors_are_left_alone() -> None:
    try:
        raise ValueError("of a function")
    except ValueError as error:
        raise_of_handler(error)


def outcomes(call: Callable[[], Any]) -> list[str]:
    """Make a call again and again, and raise something at its first line, then at its second, and so on: what comes out."""
    found, moment = list[str](), 0
    while True:
        left = moment

        def trace(frame: Any, event: str, argument: Any) -> Any:
            nonlocal left
            if event == "line":
                left -= 1
                if left == -1:
                    raise Late
            return trace

        kept = sys.gettrace()
        sys.settrace(trace)
        try:
            call()
            out = ""
        except BaseException as error:
            out = type(error).__name__
        finally:
            sys.settrace(kept)
        if left >= 0:
            return found
        found.append(out)
        moment += 1


def test_what_is_raised_at_any_line_of_a_comparison_comes_out() -> None:
    """As a handler might raise it, which Python calls between any two steps. `numpy.array_equal` would return False."""
    one, other = np.arange(6.0), np.arange(6.0)
    calls: list[Callable[[], Any]] = [lambda: arrays_equal(one, other), lambda: arrays_equal("tool", "tool")]
    for call in calls:
        call()
        seen = outcomes(call)
        assert set(seen) == {"Late"}


@pytest.mark.slow
def test_what_is_raised_at_any_line_of_looking_at_a_scene_comes_out() -> None:
    pytest.importorskip("coal")
    arm = kinseek.load("planar2")
    scene = kinseek.Scene.of(arm, capsules=0.02)
    seen = outcomes(lambda: scene.fits(arm.mechanism))
    assert len(seen) > 10
    assert set(seen) == {"Late"}


def test_nothing_in_the_package_compares_by_a_function_that_swallows_errors() -> None:
    package = Path(kinseek.__file__).parent
    used = {path.name for path in package.rglob("*.py") if "np.array_equal(" in path.read_text("utf-8")}
    assert used == set()
