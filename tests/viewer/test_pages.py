"""Open pages without a browser: in which order goals, motions, trackers and searches are shown."""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

import kinseek
import kinseek.viewer
from kinseek import Arm, InvalidUse
from kinseek.viewer import words
from kinseek.viewer.meshes import Meshes
from kinseek.viewer.options import ViewerOptions
from kinseek.viewer.session import GoalResult, Session, nearest_of
from kinseek.viewer.workers import Turns
from viewer_pages import KINDS, client, far, function_arm, page_of, wait_until


def meanwhile(
    monkeypatch: pytest.MonkeyPatch, session: Session, method: str, act: Callable[[], None]
) -> None:
    """Let something happen when this method of a session is next called, before it works."""
    work = getattr(session, method)

    def once(*given: Any) -> Any:
        monkeypatch.undo()
        act()
        return work(*given)

    monkeypatch.setattr(session, method, once)


@pytest.fixture(scope="module")
def sessions() -> dict[str, Session]:
    return {name: Session(kinseek.load(name)) for name in KINDS}


def test_a_branch_picked_while_the_goal_changes_leaves_none_of_the_goal_before(
    sessions: dict[str, Session],
) -> None:
    with page_of(sessions["ur5e"]) as page:
        arm, before = page.arm, page.branches.q
        moved = arm.fk(arm.sample(1, 3)[0])
        with page._solver._changed:  # It takes up the goal after the click.
            page.change(target=moved)
            page.pick(1)
        wait_until(lambda: page.idle)
        assert page.branches.q.shape != before.shape or np.abs(page.branches.q - before).max() > 0.1
        np.testing.assert_allclose(
            arm.fk(page.branches.q)[:, :3, 3], np.tile(moved[:3, 3], (len(page.branches), 1)), atol=1e-6
        )
        assert page.result.reached
        page.pick(1)
        wait_until(lambda: page.idle)
        assert nearest_of(page.branches, page.result.q) == 1


def test_a_page_solves_few_goals_a_second_and_the_last_one(sessions: dict[str, Session]) -> None:
    """One page that moved its goal without a pause delayed others by 0.8 s, four by 2 s."""
    with page_of(sessions["ur5e"]) as page:
        solved, solve = list[Any](), sessions["ur5e"].solve

        def counted(options: ViewerOptions) -> GoalResult:
            solved.append(options.target)
            return solve(options)

        page._session.solve = counted
        begin, target = time.monotonic(), page.options.target
        while time.monotonic() - begin < 1.0:
            target = target @ kinseek.pose([1e-4, 0.0, 0.0])
            page.change(target=target)
            time.sleep(1e-3)
        rest(page)
        assert len(solved) <= 40
        np.testing.assert_array_equal(solved[-1], page.options.target)


def test_a_page_that_cannot_begin_leaves_no_threads(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("viser")
    from kinseek.viewer.page import Page

    def gone(page: Page) -> None:
        raise ConnectionError("the client left")

    monkeypatch.setattr(Page, "_begin", gone)
    monkeypatch.setattr(Page, "_fetch", lambda page: None)
    before = set(threading.enumerate())
    with pytest.raises(ConnectionError):
        Page(client(), sessions["ur5e"], Meshes())
    for thread in set(threading.enumerate()) - before:
        thread.join(5)
        assert not thread.is_alive()


def motion_of(arm: Arm) -> kinseek.Trajectory:
    """A short motion in time."""
    q = np.linspace(arm.lower, arm.upper, 9)[3:5]
    q = q[0] + np.linspace(0.0, 0.3, 12)[:, None] * (q[1] - q[0])
    return arm.follow(arm.fk(q), start=q[0]).timed(acceleration=20.0)


def rest(page: Any) -> None:
    """Wait until all work of a page is done."""
    wait_until(lambda: page.idle, 60.0)


@pytest.mark.parametrize("name", ["ur5e", "panda"])
def test_a_motion_is_shown_at_every_time(
    name: str, sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("trimesh")
    session, browser = sessions[name], client()
    motion = motion_of(session.arm)
    with page_of(session, motion, browser) as page:
        begins, ends = np.moveaxis(browser.scene.add_line_segments.call_args_list[-1].args[1], 1, 0)
        ends_of_motion = session.arm.fk(motion.q([0.0, motion.duration]))[:, :3, 3]
        np.testing.assert_allclose([begins[0], ends[-1]], ends_of_motion, atol=1e-5)
        for t in (0.0, 0.4 * motion.duration, motion.duration, motion.duration + 0.001):
            page.show_time(t)
            shown = min(t, motion.duration)
            np.testing.assert_array_equal(page.options.q, motion.q(shown))
            assert page.panel.time.value == shown
            assert f"{shown:.3f} of {motion.duration:.3f} s; tip {motion.tip_speed(shown):.3f} m/s" in (
                page.panel.motion.content
            )
        # Played in real time from its begin, as its end is shown.
        times: list[tuple[float, float]] = []
        monkeypatch.setattr(page, "show_time", lambda t: times.append((time.monotonic(), t)))
        page._player.give("motion")
        rest(page)
        real, played = np.array(times).T
        assert played[0] < 0.5 * motion.duration
        assert (np.diff(played) > 0.0).all()
        assert played[-1] == motion.duration
        # A picture shows a time that has come, and none is shown too early.
        assert ((real - real[0])[:-1] >= (played - played[0])[:-1] - 1e-3).all()


def test_passes_of_a_search_are_shown(sessions: dict[str, Session]) -> None:
    pytest.importorskip("trimesh")
    with page_of(sessions["ur5e"]) as page:
        page.panel.passes.value = True
        for search in ("Atlas", "DivideAndConquer"):  # Without windows of joint values, and with them.
            page.change(search=search)
            page.show_passes(True)
            rest(page)
            for number, one in enumerate(page.trace):
                page.choose_pass(number)
                rest(page)
                assert one.name in page.panel.pass_text.content
                assert page.panel.number.value == number + 1 or len(page.trace) == 1


def test_the_loop_never_waits_for_a_slow_arm() -> None:
    """It calls no FK, and needs the lock of the page, which must not be held during FK."""
    pytest.importorskip("trimesh")
    threads, held, arm = set[str](), list[bool](), function_arm()
    pages = list[Any]()

    def fk(q: Any) -> Any:
        threads.add(threading.current_thread().name)
        held.extend(page._lock._is_owned() for page in pages)
        return arm.fk(q)

    with page_of(Session(Arm.from_fk(fk, arm.lower, arm.upper))) as page:
        rest(page)
        threads.clear()
        pages.append(page)
        page.edit(page.another_goal, "goal")
        page.edit(page.goal_to_arm, "goal")
        rest(page)
        target = page.options.target.copy()
        target[0, 3] += 100.0  # Out of reach: a proof shows the nearest pose.
        page.change(target=target)
        page.panel.passes.value = True
        page.show_passes(True)
        rest(page)
        page.servo(True)
        wait_until(lambda: not page.panel.servo.value or "data-shares" in str(page.panel.shares.content))
        page.servo(False)
        rest(page)
    assert any(name.endswith("bodies") for name in threads)
    assert all(name.startswith("kinseek page") for name in threads)
    assert held
    assert not any(held)


def test_a_motion_of_an_arm_of_other_lengths_is_refused() -> None:
    pytest.importorskip("viser")
    arm, other = kinseek.load("ur5e"), kinseek.load("ur10e")
    motion = other.move([0, -1, 1, 0, 1, 0], [1, -1, 1, 0, 1, 0], 2.0, 5.0)
    with pytest.raises(InvalidUse, match="one of 'ur10e' with other lengths, or another tool"):
        kinseek.viewer.show(arm, trajectory=motion, open_browser=False, block=False)


def test_a_pass_of_a_slow_arm_is_shown_outside_the_loop() -> None:
    pytest.importorskip("trimesh")
    threads = set[str]()

    def fk(q: Any) -> Any:
        threads.add(threading.current_thread().name)
        return arm.fk(q)

    arm = kinseek.load("ur5e")
    slow = Arm.from_fk(fk, arm.lower, arm.upper, vectorized=False)
    with page_of(Session(slow)) as page:
        page.panel.passes.value = True
        page.change(search="DivideAndConquer")
        page.show_passes(True)
        rest(page)
        threads.clear()
        page.choose_pass(0)
        assert page.panel.number.value == 1
        page.choose_pass(1)
        assert page.panel.number.value == 2
        rest(page)
        assert page.panel.number.value == 2
        assert page.trace[1].name in page.panel.pass_text.content
    assert threads
    assert all(name.endswith("motions") for name in threads)


@pytest.fixture
def servo_page(sessions: dict[str, Session]) -> Iterator[Any]:
    """A page whose goal drives a UR5e."""
    pytest.importorskip("trimesh")
    with page_of(sessions["ur5e"]) as page:
        page.servo(True)
        wait_until(lambda: "data-shares='6'" in str(page.panel.shares.content))
        yield page


def test_a_goal_drives_a_tracker_within_its_limits(servo_page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    page, track = servo_page, servo_page._session.track
    steps: list[Any] = []

    def recording(options: ViewerOptions, limits: Any) -> Any:
        tracker = track(options, limits)
        step = tracker.step

        def record(T: Any) -> Any:
            steps.append(step(T))
            return steps[-1]

        tracker.step = record
        return tracker

    monkeypatch.setattr(page._session, "track", recording)
    page.panel._choose_limit("acceleration", 5.0)  # A new limit begins a new tracker, at rest.
    wait_until(lambda: steps)
    q = page.options.q
    target = page.options.target @ kinseek.pose([0.1, 0.0, 0.05], rpy=[0.0, 0.2, 0.0])
    page.change(target=target)
    wait_until(lambda: np.abs(page.arm.fk(page.options.q) - target).max() < 1e-6)
    way = np.array([q, *(step.q for step in steps)])
    accelerations = np.diff(way, 2, axis=0) / 0.002**2
    assert 4.9 < np.abs(accelerations).max() < 5.0001
    assert np.abs(np.diff(accelerations, axis=0) / 0.002).max() < 500.01
    wait_until(lambda: "Tracking" in page.panel.result.content)  # Shown less often than the arm moves.
    assert page.branches is None
    page.servo(False)
    rest(page)
    assert page.result.reached
    assert not page.panel.servo.value
    assert page.panel.shares.content == ""
    assert page.branches is not None


def test_a_page_that_is_closed_ends_its_tracker(servo_page: Any, caplog: pytest.LogCaptureFixture) -> None:
    began = time.monotonic()
    servo_page.close()
    assert time.monotonic() - began < 1.0
    assert not servo_page._player._thread.is_alive()
    assert caplog.text == ""


def test_a_goal_that_cannot_be_tracked_is_said(servo_page: Any) -> None:
    servo_page.change(free=["rz"])
    servo_page.change(free=["x", "y", "z", "rx", "ry", "rz"])
    wait_until(lambda: not servo_page._servoing)
    rest(servo_page)
    assert "data-status='refused'" in servo_page.panel.result.content
    assert not servo_page.panel.servo.value


@pytest.mark.parametrize("name", KINDS)
def test_every_arm_can_be_tracked(name: str, sessions: dict[str, Session]) -> None:
    session = sessions[name]
    tracker = session.track(session.begin, {"acceleration": 10.0, "jerk": 500.0})
    assert np.isfinite(tracker.velocity).all()
    step = tracker.step(session.begin.target)
    assert step.status is kinseek.TrackStatus.TRACKING
    assert f"data-shares='{session.arm.dof}'" in words.shares_html(
        session.arm, np.zeros((2, session.arm.dof))
    )


def test_texts_of_a_tracker() -> None:
    arm = kinseek.load("planar2")
    tracker = arm.track(
        [0.3, 0.4], velocity=1.0, acceleration=2.0, goal=kinseek.Goal.position([0.0, 0.0, 0.0])
    )
    step = tracker.step([0.0, 1.0, 0.0])
    html = words.servo_html(step)
    assert "data-status='open'" in html
    assert str(step.status) in html
    assert step.limited is not None
    assert f"acceleration of {step.limited[0]}" in html
    bars = words.shares_html(arm, np.array([[0.5, 0.0], [1.0, 2.0]]))
    assert [bars.count(f"width:{width}%") for width in (0, 50, 100)] == [1, 1, 2]
    assert bars.count("#e8590c") == 2


def test_what_caps_a_motion_is_said() -> None:
    arm = kinseek.load("ur5e")
    motion = motion_of(arm)
    cap = motion.bottleneck[0]
    assert f"capped by the {cap.limit} of {cap.joint}" in words.motion_html(
        motion, 0.5 * (cap.begin + cap.end)
    )


def test_a_motion_must_be_one_of_the_arm() -> None:
    ur5e, panda = kinseek.load("ur5e"), kinseek.load("panda")
    still = ur5e.follow([ur5e.fk(np.full(6, 0.3))]).timed(acceleration=1.0)
    for motion, text in (
        (np.zeros((3, 6)), "got ndarray"),
        (motion_of(panda), "one of 'ur5e' .*got one of 'panda'"),
        (still, "takes no time"),
    ):
        with pytest.raises(InvalidUse, match=text):
            kinseek.viewer.show(ur5e, trajectory=motion, port=0)  # type: ignore[arg-type]


@pytest.mark.parametrize("end", [lambda page: page.play_motion(False), lambda page: page.play_passes()])
def test_the_goal_is_solved_after_it_no_longer_drives_the_arm(
    servo_page: Any, end: Callable[[Any], None]
) -> None:
    target = servo_page.options.target @ kinseek.pose([0.1, 0.0, 0.05])
    servo_page.change(target=target)
    end(servo_page)
    rest(servo_page)
    assert servo_page.result.reached
    assert servo_page.branches is not None
    assert not servo_page.panel.servo.value


def test_a_goal_that_is_solved_while_a_motion_is_drawn_stays(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One of 40 pages with a large scene kept showing the motion."""
    arm = sessions["ur5e"].arm
    q0, q1 = arm.sample(2, seed=3)
    with page_of(sessions["ur5e"], arm.move(q0, q1, 1.0, 1.0)) as page:

        def solved() -> None:
            page.change(target=arm.fk(q1))
            wait_until(lambda: page._solver.idle)

        meanwhile(monkeypatch, page._session, "posture", solved)
        page.choose_time(0.1)
        rest(page)
        assert page.result.reached
        np.testing.assert_allclose(arm.fk(page.options.q), arm.fk(q1), atol=1e-5)


def test_the_numbers_of_a_goal_do_not_wait_for_the_clouds_of_other_pages(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """They showed the goal before, and typing one of them brought it back."""
    from kinseek.viewer import page as module

    with page_of(sessions["ur5e"]) as page:
        turns = Turns(1)
        assert turns.begin(lambda: False)  # Another page's.
        monkeypatch.setattr(module, "_CLOUDS", turns)
        target = page.options.target @ kinseek.pose([0.1, 0.0, 0.05])
        page.change(target=target)
        wait_until(lambda: np.allclose(page.panel.place.value, target[:3, 3], atol=1e-3))
        turns.end()


def test_numbers_that_are_typed_count_although_others_are_shown_meanwhile(
    sessions: dict[str, Session],
) -> None:
    """Up to one of five rotations that were typed 0.12 s after a position was lost."""
    with page_of(sessions["ur5e"]) as page:
        place = tuple(page.options.target[:3, 3] + [0.05, 0.0, 0.0])
        with page._editor._changed:  # It reads them later.
            page.panel.place.value = place
            page.panel._type_goal()
            page._store("keep")
            assert page.panel.place.value == place
            page.panel.show_target(page.options)
        wait_until(lambda: np.allclose(page.options.target[:3, 3], place))
        rest(page)
        np.testing.assert_allclose(page.panel.place.value, place, atol=1e-6)


def test_a_motion_that_is_chosen_during_a_search_stays_until_the_next_goal(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The arm jumped to the result of the search, beside the text of the motion."""
    arm = sessions["ur5e"].arm
    q0, q1 = arm.sample(2, seed=3)
    motion = arm.move(q0, q1, 1.0, 1.0)
    with page_of(sessions["ur5e"], motion) as page:

        def chosen() -> None:
            page.choose_time(0.2)
            wait_until(lambda: page._player.idle)

        meanwhile(monkeypatch, page._session, "solve", chosen)
        page.change(target=arm.fk(q1))
        rest(page)
        np.testing.assert_array_equal(page.options.q, motion.q(0.2))
        assert "0.2" in page.panel.motion.content
        assert (page.panel.branches.content, page.panel.call.content) == ("", "")
        page.change(target=arm.fk(q0))
        rest(page)
        assert page.result.reached
        assert page.panel.motion.content == ""
        assert "Branch" in page.panel.branches.content
        assert "arm.ik" in page.panel.call.content


def test_the_numbers_are_those_of_the_pose_that_a_proof_found() -> None:
    """The arm stood at the pose of the proof, beside the errors and the call of the search's."""
    arm = kinseek.load("so101")
    T = kinseek.pose([0.382, 0.077, -0.208], rpy=[0.485, -0.158, 1.313])
    with page_of(Session(arm)) as page:
        page.change(target=T, free=["x"])
        rest(page)
        result, goal = page.result, page.options.goal
        assert result.call.startswith("arm.prove(kinseek.Goal.pose(T, free=['x']), gap=0.")
        np.testing.assert_array_equal(page.options.q, result.q)
        np.testing.assert_array_equal(
            eval(result.call, {"arm": arm, "kinseek": kinseek, "T": page.options.target}), result.q
        )
        assert result.solution.weighted_error < arm.ik(goal, near=result.near).weighted_error
        assert f"{float(result.solution.position_error):.3g} m" in page.panel.result.content
        assert "arm.prove" in page.panel.call.content


def test_the_tracker_ends_also_if_its_limits_change_meanwhile(servo_page: Any) -> None:
    """A new tracker took the place of the end that waited."""
    with servo_page._player._changed:
        servo_page.servo(False)
        servo_page.change_limits()
    rest(servo_page)
    assert not servo_page._servoing
    assert servo_page.result.reached


def test_the_refusal_of_a_goal_stays_beside_a_proof(sessions: dict[str, Session]) -> None:
    with page_of(sessions["ur5e"]) as page:
        page.change(target=far(page.options).target)
        wait_until(lambda: "proof" in page.panel.result.content or "Proved" in page.panel.result.content)
        page.panel.place.value = (1e8, 0.0, 0.0)
        page.panel._type_goal()
        rest(page)
        assert "1e+07 m" in page.panel.result.content


def test_a_refusal_stays_beside_the_result_of_a_search_that_still_ran(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """It vanished with the result of the goal before, and the number that was refused stayed in its field."""
    with page_of(sessions["ur5e"]) as page:

        def typed() -> None:
            page.panel.place.value = (1e8, 0.0, 0.0)
            page.panel._type_goal()
            wait_until(lambda: page._editor.idle)

        meanwhile(monkeypatch, page._session, "solve", typed)
        target = page.options.target @ kinseek.pose([0.1, 0.0, 0.05])
        page.change(target=target)
        rest(page)
        assert "1e+07 m" in page.panel.result.content
        np.testing.assert_allclose(page.panel.place.value, target[:3, 3], atol=1e-5)
        page.change(target=target @ kinseek.pose([0.0, 0.0, 0.01]))
        rest(page)
        assert "1e+07 m" not in page.panel.result.content


@pytest.mark.parametrize("search", ["Atlas", "DivideAndConquer"])
@pytest.mark.parametrize("tracked", [True, False], ids=["a tracker", "a motion"])
def test_what_was_not_searched_for_has_no_passes(
    tracked: bool, search: str, sessions: dict[str, Session]
) -> None:
    """Beside a tracker and a motion, those of an earlier goal or of another search stayed."""
    arm = sessions["ur5e"].arm
    q0, q1 = arm.sample(2, seed=3)
    with page_of(sessions["ur5e"], arm.move(q0, q1, 1.0, 1.0)) as page:
        page.panel.passes.value = True
        page.change(target=arm.fk(q1), search=search)
        rest(page)
        assert "best so far" in page.panel.pass_text.content
        if tracked:
            page.servo(True)
            wait_until(lambda: page.panel.servo.value)
            page.change(target=arm.fk(q0))
        else:
            page.choose_time(0.1)
        wait_until(lambda: page._clouder.idle and (tracked or page._player.idle))
        assert page.trace is None
        assert page.panel.pass_text.content == ""
        page.view.show_pass = drawn = MagicMock()
        page.servo(False)
        page.change(target=arm.fk(q0))
        rest(page)
        assert "best so far" in page.panel.pass_text.content
        assert drawn.call_args.args[0] is not None


def test_a_pass_is_not_drawn_after_passes_are_no_longer_wanted(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The nodes of a slow arm were drawn after the box was unticked, and stayed."""
    from kinseek.viewer import clouds

    with page_of(sessions["ur5e"]) as page:
        page.panel.passes.value = True
        page.show_passes(True)
        rest(page)
        drawn = list[Any]()
        monkeypatch.setattr(page.view, "show_pass", lambda *given: drawn.append(given))
        visited = clouds.visited

        def unticked_meanwhile(*given: Any) -> Any:
            page.panel.passes.value = False
            page.show_passes(False)
            return visited(*given)

        monkeypatch.setattr(clouds, "visited", unticked_meanwhile)
        page.choose_pass(0)
        rest(page)
        assert set(drawn) == {(None, None)}


def test_a_plan_that_waited_for_a_tracker_comes_after_a_motion_is_chosen(
    sessions: dict[str, Session],
) -> None:
    """With *Time* after a tracker, the motion offered was the one given, and no plan came."""
    pytest.importorskip("coal")
    arm = sessions["ur5e"].arm
    q0, q1 = arm.sample(2, seed=3)
    with page_of(Session(arm, kinseek.Scene.of(arm, capsules=0.03)), arm.move(q0, q1, 1.0, 1.0)) as page:
        page.plan(True)
        page.servo(True)
        wait_until(lambda: page._servoing and page.panel.servo.value)
        page.change(target=page.options.target @ kinseek.pose([0.05, 0.0, 0.0]))
        wait_until(lambda: page._planner.idle)
        page.choose_time(0.1)
        rest(page)
        assert page.trajectory is not page._given_motion
        np.testing.assert_allclose(
            arm.fk(page.trajectory.q(page.trajectory.duration)), page.options.target, atol=1e-5
        )


def test_bodies_are_named_over_the_whole_of_a_long_motion(monkeypatch: pytest.MonkeyPatch) -> None:
    """Only those of its first seconds were, and nothing said that there are others."""
    pytest.importorskip("coal")
    from kinseek.viewer import session as module

    arm = kinseek.load("ur5e")
    scene = kinseek.Scene.of(arm, capsules=0.05)
    q0, q1 = np.array([0.0, -1.2, 1.4, -0.5, 0.7, 0.1]), np.array([2.0, -1.2, 1.4, -0.5, 0.7, 0.1])
    scene.add_box("at the begin", [0.1] * 3, arm.fk(q0))
    scene.add_box("at the end", [0.1] * 3, arm.fk(q1))
    motion, session = arm.move(q0, q1, 1.0, 1.0), Session(arm, scene)
    assert {"at the begin", "at the end"} <= set(session.swept(motion).hit)
    assert module.OTHERS not in session.swept(motion).hit
    clock = MagicMock()
    clock.monotonic.side_effect = (k * module.NAMING / 20 for k in itertools.count())
    monkeypatch.setattr(module, "time", clock)
    swept = session.swept(motion)
    assert {"at the begin", "at the end"} <= set(swept.hit)
    assert swept.hit[-1] == module.OTHERS
    assert session.swept(motion, stopped=lambda: True).hit == ()


def test_passes_of_a_search_before_do_not_stay_where_none_were_recorded(sessions: dict[str, Session]) -> None:
    with page_of(sessions["ur5e"]) as page:
        page.panel.passes.value = True
        page.change(search="DivideAndConquer")
        rest(page)
        page.view.show_pass = drawn = MagicMock()
        page.pick(1)
        rest(page)
        assert page.trace is None
        assert "recorded no passes" in page.panel.pass_text.content
        assert drawn.call_args.args == (None, None)


def test_a_motion_that_is_played_stops_no_clouds(sessions: dict[str, Session]) -> None:
    """Each picture made them wait again, and the passes of the goal before stayed for as long."""
    arm = sessions["ur5e"].arm
    q0, q1 = arm.sample(2, seed=3)
    with page_of(sessions["ur5e"], arm.move(q0, q1, 0.2, 0.2)) as page:
        page.panel.passes.value = True
        page.show_passes(True)
        rest(page)
        page.view.show_cloud = drawn = MagicMock()
        page.play_motion(True)
        wait_until(lambda: page.trace is None)
        page.change(samples=True)
        wait_until(lambda: any(call.args[1] is not None for call in drawn.call_args_list))
        assert not page._player.idle
        assert page.panel.pass_text.content == ""


def test_a_search_for_passes_says_nothing_about_a_motion_that_is_chosen_meanwhile(
    sessions: dict[str, Session], monkeypatch: pytest.MonkeyPatch
) -> None:
    arm = sessions["ur5e"].arm
    q0, q1 = arm.sample(2, seed=3)
    with page_of(sessions["ur5e"], arm.move(q0, q1, 1.0, 1.0)) as page:

        def chosen() -> None:
            page.choose_time(0.1)
            wait_until(lambda: page._player.idle)

        meanwhile(monkeypatch, page._session, "traced", chosen)
        page.panel.passes.value = True
        page.show_passes(True)
        rest(page)
        assert page.trace is None
        assert page.panel.pass_text.content == ""
