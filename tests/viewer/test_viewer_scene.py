"""The viewer with a scene: what is drawn, hit, avoided, edited and planned."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest

import kinseek
from kinseek import Scene, Status, viewer
from kinseek.viewer import words
from kinseek.viewer.meshes import Meshes
from kinseek.viewer.session import Session, call_of, status_of

pytest.importorskip("coal")
pytest.importorskip("trimesh")

EVIL = "<b>wall</b>\n\u202e"
UR5E = kinseek.load("ur5e")
FREE = kinseek.pose([0.45, -0.3, 0.35], rpy=[np.pi, 0.0, 0.0])
INSIDE = kinseek.pose([0.45, 0.0, 0.2], rpy=[np.pi, 0.0, 0.0])


def cell() -> Scene:
    scene = Scene.of(UR5E, capsules=0.05)
    scene.add_box(EVIL, (0.6, 0.03, 0.7), kinseek.pose([0.55, 0.0, 0.3]))
    return scene


@pytest.fixture(scope="module")
def session() -> Session:
    return Session(UR5E, cell())


def wait_until(there: Callable[[], object], seconds: float = 20.0) -> None:
    end = time.monotonic() + seconds
    while not there():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.005)


def client() -> Any:
    """Stands for a browser; every 3D object and every input is one of its own."""
    made = MagicMock(client_id=1)
    made.camera.aspect = 1.5
    for name in ("add_html", "add_slider", "add_checkbox", "add_vector3", "add_dropdown", "add_button_group"):
        getattr(made.gui, name).side_effect = lambda *given, **named: MagicMock(value=False)
    for name in (
        "add_frame",
        "add_mesh_simple",
        "add_point_cloud",
        "add_transform_controls",
        "add_line_segments",
    ):
        getattr(made.scene, name).side_effect = lambda *given, **named: MagicMock()
    return made


@pytest.fixture
def page(session: Session, monkeypatch: pytest.MonkeyPatch) -> Iterator[Any]:
    pytest.importorskip("viser")
    from kinseek.viewer.page import Page

    monkeypatch.setattr(Page, "_fetch", lambda page: None)
    made = Page(client(), session, Meshes())
    wait_until(lambda: made.idle)
    yield made
    made.close()


def goal(page: Any, target: Any) -> None:
    page.change(target=target)
    wait_until(lambda: page.idle)


def test_answers_in_a_scene_are_free_and_the_call_says_so(session: Session) -> None:
    scene = session.scene
    assert scene is not None
    assert scene.free(session.begin.q)
    for target in UR5E.fk(UR5E.sample(30, seed=3)):
        result = session.solve(session.begin.but(target=target))
        assert result.reached == bool(UR5E.ik(target, scene=scene).success)
        assert bool(session.contacts(result.q)) == (not result.reached) == (not scene.free(result.q))
    assert call_of(session.begin, True) == "arm.ik(T, near=q, scene=scene)"


def test_a_goal_that_is_blocked_is_told_and_proved(session: Session) -> None:
    result = session.solve(session.begin.but(target=INSIDE))
    assert result.blocked
    assert status_of(result, None) == (str(Status.BLOCKED), "open")
    proved = session.blocked(result)
    assert status_of(proved, None) == (str(Status.PROVED_BLOCKED), "bad")
    assert EVIL in {name for one in session.contacts(proved.q) for name in (one.a, one.b)}


def test_the_page_shows_what_the_arm_hits(page: Any) -> None:
    goal(page, FREE)
    assert page.result.reached
    assert page.panel.hits.content == ""
    drawn = page.view.bodies._drawn
    links = [one for one in drawn.values() if one.body.is_link]
    assert not any(one.frame.visible for one in links)
    assert drawn[EVIL].frame.visible
    grey = drawn[EVIL].mesh.color
    goal(page, INSIDE)
    assert page.result.blocked
    assert "data-status='bad'" in page.panel.result.content
    assert "Proved blocked" in page.panel.result.content
    assert drawn[EVIL].mesh.color != grey
    hit = {name for one in page._session.contacts(page.result.q) for name in (one.a, one.b)}
    assert {one.body.name for one in links if one.frame.visible} == hit - {EVIL}
    assert "; 0 free" in page.panel.branches.content
    goal(page, FREE)
    assert drawn[EVIL].mesh.color == grey
    assert not any(one.frame.visible for one in links)


def test_names_of_bodies_are_text_and_no_tags(page: Any) -> None:
    goal(page, INSIDE)
    html = page.panel.hits.content
    assert "&lt;b&gt;wall&lt;/b&gt;" in html
    assert "<b>" not in html
    assert "\u202e" not in html
    assert "\n" not in html


def test_a_tracker_brakes_before_bodies_and_names_them(session: Session) -> None:
    begin = session.begin.but(target=FREE, q=UR5E.ik(FREE, scene=session.scene).q)
    tracker = session.track(begin, {"acceleration": 10.0, "jerk": 500.0})
    across = FREE.copy()
    across[1, 3] = 0.3
    step = next(step for step in (tracker.step(across) for _ in range(2000)) if step.obstacle)
    html = words.servo_html(step)
    assert "brakes before" in html
    assert "&lt;b&gt;wall&lt;/b&gt;" in html
    assert "mm apart" in html


def test_a_scene_must_be_one_of_the_arm() -> None:
    for wrong, error, text in (
        ({"scene": 3}, kinseek.InvalidScene, "must be a kinseek.Scene, got int"),
        (
            {"scene": Scene.of(kinseek.load("panda"), capsules=0.05)},
            kinseek.InvalidScene,
            "this scene is of 'panda'",
        ),
        ({"clearance": 0.1}, kinseek.InvalidProblem, "clearance= needs a scene"),
        ({"scene": cell(), "clearance": -1.0}, kinseek.InvalidScene, "clearance must be a length"),
    ):
        with pytest.raises(error, match=text):
            viewer.show(UR5E, port=0, open_browser=False, **wrong)


def test_a_tool_that_the_scene_does_not_know_is_that_of_the_arm() -> None:
    arm = UR5E.with_tool(kinseek.pose([0.0, 0.0, 0.1]))
    session = Session(arm, cell())
    result = session.solve(session.begin.but(target=FREE))
    assert result.reached
    np.testing.assert_allclose(arm.fk(result.q), FREE, atol=1e-5)
