"""Scenes that other threads change, and calls that Ctrl-C interrupts."""

from __future__ import annotations

import contextlib
import copy
import signal
import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from cells import scene_of, write_arm
from kinseek import InvalidScene, Scene
from kinseek.collision import Box, Sphere, contents
from kinseek.collision import scene as scene_module
from kinseek.collision.assembly import assemble
from kinseek.collision.contents import Contents
from kinseek.collision.engine import Engine

pytest.importorskip("pinocchio")
pytest.importorskip("coal")


@pytest.fixture
def arm(tmp_path: Path) -> kinseek.Arm:
    return kinseek.load(write_arm(tmp_path / "arm"), tip="tip")


@pytest.fixture
def scene(arm: kinseek.Arm) -> Scene:
    return scene_of(arm)


def test_a_change_by_another_thread_during_a_question(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, arm: kinseek.Arm
) -> None:
    """Of 3,564 rounds with a camera's thread beside them two motions that hit something were free."""
    q = arm.sample(1, seed=1)[0]
    for i in range(3):
        scene.add_box(f"box {i}", (0.1, 0.1, 0.1), kinseek.pose([2.0, 0.0, i]))
    scene.add_sphere("ball", 1.0, arm.fk(q))
    nearest, hits, motion = scene.nearest(q), scene.hits(q), scene.free_motion(q, q + 0.01)
    between = scene.hits_between(q, q + 0.01)
    assert hits
    assert not motion

    def changed(question: Callable[..., Any]) -> Callable[..., Any]:
        def asked(*args: Any) -> Any:
            monkeypatch.undo()
            scene.remove("box 0")
            scene.remove("ball")
            return question(*args)

        return asked

    questions: tuple[tuple[Any, str, Callable[[], Any], Any], ...] = (
        (Engine, "nearest", lambda: scene.nearest(q)[:3], nearest[:3]),
        (Engine, "touching", lambda: scene.hits(q), hits),
        (scene_module, "are_free", lambda: scene.free_motion(q, q + 0.01), motion),
        (scene_module, "are_free", lambda: scene.hits_between(q, q + 0.01), between),
    )
    for place, name, ask, told in questions:
        monkeypatch.setattr(place, name, changed(getattr(place, name)))
        assert ask() == told, name
        scene.add_box("box 0", (0.1, 0.1, 0.1), kinseek.pose([2.0, 0.0, 0.0]))
        scene.add_sphere("ball", 1.0, arm.fk(q))
        assert not scene.free(q)


def test_a_body_that_is_added_while_another_thread_prepares_the_scene_is_checked(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, arm: kinseek.Arm
) -> None:
    q = arm.sample(1, seed=1)[0]

    def interrupted(*args: Any) -> Any:
        made = assemble(*args)
        monkeypatch.undo()
        scene.add_sphere("ball", 1.0, arm.fk(q))
        return made

    monkeypatch.setattr(contents, "assemble", interrupted)
    assert scene.nearest(q).b != "ball"
    assert "ball" in {contact.b for contact in scene.hits(q)}


def test_no_other_thread_sees_half_of_a_change(
    scene: Scene, monkeypatch: pytest.MonkeyPatch, arm: kinseek.Arm, tmp_path: Path
) -> None:
    """A tool that was being attached hit the link that carries it."""
    q = next(q for q in arm.sample(100, seed=1) if scene.free(q))
    seen, enter = list[bool](), Contents._enter

    def watched(self: Any, body: Any) -> None:
        enter(self, body)
        seen.append(scene.free(q))

    monkeypatch.setattr(Contents, "_enter", watched)
    scene.attach("tool", Box((0.05, 0.05, 0.05)), "wrist")
    link = '<link name="l{0}"><collision><origin xyz="0 0 {0}"/><geometry><box size="9 9 9"/></geometry></collision></link>'
    joint = '<joint name="j" type="fixed"><parent link="l1"/><child link="l2"/></joint>'
    (tmp_path / "cell.urdf").write_text(f'<robot name="c">{link.format(1)}{link.format(2)}{joint}</robot>')
    scene.add_file(tmp_path / "cell.urdf")
    assert seen == [True] * 3
    assert not scene.free(q)


@pytest.mark.parametrize("ask", [lambda scene: scene.digest, repr])
def test_a_description_is_of_one_moment(
    ask: Callable[[Scene], str], scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The bodies were those before a change, and the pairs those after it."""
    before, now = ask(scene), Contents._now

    def changed(self: Any) -> Any:
        monkeypatch.undo()
        scene.add_sphere("ball", 0.1)
        return now(self)

    monkeypatch.setattr(Contents, "_now", changed)
    assert ask(scene) in (before, ask(scene))


@pytest.mark.parametrize("name", ["_publish", "_now", "__getstate__"])
def test_a_body_never_has_the_exceptions_of_the_one_that_replaces_it(
    scene: Scene, arm: kinseek.Arm, name: str
) -> None:
    """Before, the tool hits one box; after, it hits the other, and is where it may touch the first."""
    q = next(q for q in arm.sample(100, seed=1) if scene.free(q))
    places = [kinseek.pose([0.0, 0.0, z]) for z in (2.0, 4.0)]
    for box, place in zip("ab", places, strict=True):
        scene.add_box(box, (0.1, 0.1, 0.1), arm.fk(q) @ place)
    assert scene.free(q)
    tool = Box((0.05, 0.05, 0.05))
    changes = [("tool", tool, "tip", place, [free]) for place, free in zip(places, "ba", strict=True)]
    seen, steps, at = set[bool](), 0, 0

    def between(frame: Any, event: str, _: Any) -> Any:
        """Let what another thread can do between any two instructions happen there."""
        nonlocal steps
        if frame.f_code is not getattr(Contents, name).__code__ or event == "return":
            return between
        frame.f_trace_opcodes = True
        if event == "opcode":
            steps += 1
            sys.settrace(None)
            if name == "_publish":
                seen.add(copy.copy(scene).free(q))
            elif steps == at:
                scene.attach(*changes[1], replace=True)
            sys.settrace(between)
        return between

    def traced(call: Callable[[], Any]) -> Any:
        before = sys.gettrace()
        sys.settrace(between)
        try:
            return call()
        finally:
            sys.settrace(before)

    scene.attach(*changes[0])
    if name == "_publish":
        traced(lambda: scene.attach(*changes[1], replace=True))
    while name != "_publish" and steps >= at:
        scene.attach(*changes[0], replace=True)
        steps, at = 0, at + 1
        asked = traced(partial(copy.copy, scene)) if name == "__getstate__" else scene
        seen.add(traced(partial(asked.free, q)))
    assert seen == {False}
    assert max(steps, at) > 5


@pytest.mark.parametrize("call", ["plan", "follow", "move", "timed", "ik", "branches", "free_until"])
def test_a_scene_that_changes_during_a_long_call_is_an_error(
    scene: Scene, arm: kinseek.Arm, call: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of 1,938 plans 922 were free neither in the scene before nor in that after the change."""
    q0, q1 = [q for q in arm.sample(100, seed=1) if scene.free(q)][:2]
    poses = arm.fk(np.linspace(q0, q0 + 1e-3, 3))
    path = arm.follow(poses, scene=scene, start=q0)
    there = kinseek.pose([0.0, 0.0, 9.0])
    scene.add_arm("other", scene, q0, there)
    motion = path.timed(1.0, 1.0)
    asks: dict[str, tuple[str, Callable[[Scene], object]]] = {
        "plan": ("free_samples", lambda one: one.plan(q0, q1)),
        "follow": ("free_motion", lambda one: arm.follow(poses, scene=one, start=q0)),
        "move": ("free_motion", lambda one: arm.move(q0, q0 + 1e-3, 1.0, 1.0, scene=one)),
        "timed": ("free_motion", lambda one: replace(path, scene=one).timed(1.0, 1.0)),
        "ik": ("free", lambda one: arm.ik(poses[0], scene=one, prove=True)),
        "branches": ("free", lambda one: arm.branches(poses[0], scene=one, prove=True)),
        "free_until": ("_require", lambda one: one.free_until(motion, {"other": motion})),
    }
    name, asked = asks[call]
    assert asked(scene) is not None
    free = getattr(Scene, name)

    def changed(self: Scene, *args: Any, **options: Any) -> Any:
        monkeypatch.undo()
        scene.add_box("new", (0.1, 0.1, 0.1), there)
        return free(self, *args, **options)

    def fails(self: Scene, *args: Any, **options: Any) -> Any:
        changed(self, *args, **options)
        raise kinseek.InvalidProblem("the goal is in collision")

    for instead in (changed, fails):
        monkeypatch.setattr(Scene, name, instead)
        with pytest.raises(InvalidScene, match=f"another thread changed the scene during {call}"):
            asked(scene)
        scene.remove("new")
    monkeypatch.setattr(Scene, name, changed)
    asked(copy.copy(scene))
    assert "new" in scene.bodies


def test_a_change_that_is_interrupted_is_made_or_not(scene: Scene, arm: kinseek.Arm) -> None:
    """A body that was being added was listed, and never checked."""
    q = next(q for q in arm.sample(100, seed=1) if scene.free(q))
    ball, far = Sphere(0.05), kinseek.pose([0.0, 0.0, 5.0])
    other = Scene.of(kinseek.load("planar2"), capsules=0.05)
    there = {"q": [0.0, 0.0], "pose": arm.fk(q)}
    scene.add("ball", ball, far)
    scene.add_arm("other", other, [0.0, 0.0], far)
    scene.add_arm("planar", other, **there)
    changes: dict[str, Callable[[Scene], object]] = {
        "add": lambda one: one.add("new", ball, arm.fk(q)),
        "replace": lambda one: one.add("ball", ball, arm.fk(q), replace=True),
        "attach": lambda one: one.attach("ball", ball, "tip", replace=True),
        "add_arm": lambda one: one.add_arm("new", other, **there),
        "move": lambda one: one.move("other", [1.0, 1.0]),
        "allow": lambda one: one.allow("ball", "wrist"),
        "remove": lambda one: one.remove("ball"),
        "remove arm": lambda one: one.remove("planar"),
    }
    pairs, names = scene.pairs, scene._others.keys()
    for name, change in changes.items():
        done, at = False, 0
        while not done:
            at, one = at + 1, copy.copy(scene)
            one.free(q)
            done = not interrupted(partial(change, one), at)
            again = copy.copy(one)
            assert one.free(q) == again.free(q), (name, at)
            assert one.nearest(q)[:3] == again.nearest(q)[:3], (name, at)
            if not done and one.pairs == pairs:
                assert one._others.keys() == names
        assert at > 5, name


def interrupted(call: Callable[[], object], at: int) -> bool:
    """Call with Ctrl-C at a line of the module that changes scenes; return whether it came."""
    before, lines = sys.gettrace(), 0

    def traced(frame: Any, event: str, _: Any) -> Any:
        nonlocal lines
        if frame.f_code.co_filename != contents.__file__:
            return None
        lines += event in ("line", "return")
        if lines == at:
            sys.settrace(None)
            raise KeyboardInterrupt
        return traced

    sys.settrace(traced)
    try:
        call()
    except KeyboardInterrupt:
        return True
    finally:
        sys.settrace(before)
    return False


def is_unlocked(scene: Scene) -> bool:
    """Return whether no other thread keeps the engine."""
    lock = scene._engine.lock
    return bool(lock.acquire(timeout=5.0)) and lock.release() is None


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="no timers that interrupt")
def test_an_interrupted_question_leaves_the_engine_to_other_threads(scene: Scene, arm: kinseek.Arm) -> None:
    """It was locked for ever in 24 of 833 interruptions: then other threads, also of its own, waited without end."""
    q, rng = arm.sample(1, seed=1)[0], np.random.default_rng(0)
    scene.nearest(q)

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    before, count = signal.signal(signal.SIGALRM, stop), 0
    try:
        with ThreadPoolExecutor(1) as other:
            for moment in rng.uniform(30e-6, 400e-6, 800).tolist():
                with contextlib.suppress(KeyboardInterrupt):
                    signal.setitimer(signal.ITIMER_REAL, moment)
                    while True:
                        count += 1
                        scene.nearest(q)
                assert other.submit(is_unlocked, scene).result()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    assert count > 800
