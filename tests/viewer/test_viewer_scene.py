"""The viewer with a scene: what is drawn, hit, avoided, edited and planned."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Scene, Status, viewer
from kinseek.collision.surfaces import drawn_bodies
from kinseek.viewer import words
from kinseek.viewer.session import Proof, Session, nearest_of, status_of
from viewer_pages import CAMERA, client, page_of, wait_until

pytest.importorskip("coal")
trimesh = pytest.importorskip("trimesh")

pytestmark = pytest.mark.slow

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


@pytest.fixture
def page(session: Session) -> Iterator[Any]:
    pytest.importorskip("viser")
    with page_of(session) as made:
        yield made


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
        names = {"arm": UR5E, "T": target, "q": result.near, "scene": scene}
        np.testing.assert_array_equal(eval(result.call, names).q, result.q)
    assert result.call == "arm.ik(T, near=q, scene=scene, time_limit=2)"
    wary = Session(UR5E, scene, clearance=0.15)
    call = wary.solve(wary.begin).call
    assert call == "arm.ik(T, near=q, scene=scene, clearance=0.15, time_limit=2)"


def test_a_solution_of_a_search_without_the_scene_that_collides_is_not_called_solved(
    session: Session,
) -> None:
    scene = session.scene
    assert scene is not None
    told = set[tuple[bool, str]]()
    for target in UR5E.fk(UR5E.sample(20, seed=3)):
        result = session.solve(session.begin.but(target=target, search="Polished"))
        told.add((bool(result.reached and not scene.free(result.q)), status_of(result, None)[0]))
    assert (True, "This solution reaches the goal, but collides.") in told
    assert {text for collides, text in told if collides} == {"This solution reaches the goal, but collides."}
    assert "This solution reaches the goal, but collides." not in {text for hits, text in told if not hits}


def test_a_chosen_branch_that_collides_is_not_called_solved(session: Session) -> None:
    scene = session.scene
    assert scene is not None
    colliding = 0
    for target in UR5E.fk(UR5E.sample(10, seed=3)):
        options = session.begin.but(target=target)
        branches = session.branches(options)
        for q in branches.q if not isinstance(branches, str) else ():
            sentence, kind = status_of(session.picked(options, q), None)
            assert kind == ("good" if scene.free(q) else "bad")
            assert sentence.startswith(
                "Solved" if scene.free(q) else "This solution reaches the goal, but coll"
            )
            colliding += not scene.free(q)
    assert colliding > 3


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


def test_a_branch_that_collides_is_shown_with_what_it_hits(page: Any) -> None:
    target = kinseek.pose([0.45, -0.25, 0.1], rpy=[np.pi, 0.0, 0.0])
    goal(page, target)
    blocked = ~page.scene.free(page.branches.q)
    assert blocked.any()
    assert not blocked.all()
    assert f"; {(~blocked).sum()} free" in page.panel.branches.content
    colours = page.view._ghosts.node.batched_colors.reshape(-1, page.view._ghosts._each, 3)[: len(blocked), 0]
    np.testing.assert_array_equal((colours == [200, 70, 70]).all(axis=1), blocked)
    page.pick(int(np.argmax(blocked)))
    wait_until(lambda: page.idle and "Hit:" in page.panel.hits.content)
    assert not page.scene.free(page.options.q)


def test_large_meshes_are_boxes_and_the_panel_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("viser")
    ball = trimesh.creation.icosphere(2)
    scene = cell()
    scene.add(
        "<i>rock</i>",
        kinseek.collision.Mesh(ball.vertices, ball.faces, hull=False),
        kinseek.pose([9.0, 0.0, 0.0]),
    )
    for most, drawn in ((10**6, len(ball.faces)), (100, 12)):
        monkeypatch.setattr("kinseek.viewer.bodies.MOST_FACES", most)
        browser = client()
        with page_of(Session(UR5E, scene), browser=browser):
            pass
        counts = [len(call.args[2]) for call in browser.scene.add_mesh_simple.call_args_list]
        assert drawn in counts
        said = "".join(call.args[0] for call in browser.gui.add_html.call_args_list)
        assert ("drawn as boxes: &lt;i&gt;rock" in said) == (most == 100)


def boxes(page: Any) -> dict[str, np.ndarray[Any, Any]]:
    """Sizes of the boxes of a page."""
    return {
        name: body.parts[0].shape.size for name, body in page._bodies.items() if body.is_box and body.alone
    }


def test_a_new_box_does_not_take_the_name_of_one_that_was_removed(page: Any) -> None:
    """What that one may touch would count for the new one in the program that the page shows."""
    page._given = [page._bodies[EVIL]._replace(name="box 1")]
    page.add_box()
    assert page._selected == "box 2"


def test_a_box_beside_a_goal_far_away_prints_nothing_on_the_server(page: Any) -> None:
    target = page.options.target.copy()
    target[0, 3] = 1e6
    page.change(target=target)
    page.add_box()  # A UnitWarning is an error here.
    assert page._bodies["box 1"].frame.pose[0, 3] == 1e6


def test_a_body_is_dragged_quickly_among_many(session: Session) -> None:
    """Each message took time for every body, in the loop that serves all pages."""
    scene = Scene.of(UR5E, capsules=0.05)
    for i in range(300):
        scene.add_box(f"{i}", (0.02, 0.02, 0.02), kinseek.pose([2.0 + i / 40, 0.0, 0.5]))
    with page_of(Session(UR5E, scene)) as page:
        page.select_body("7")
        before = dict(page._bodies)
        made = page.view.bodies._made
        page.edit(lambda: page.place_body(kinseek.pose([1.0, 2.0, 0.5])), "drag")
        wait_until(lambda: page.idle)
        np.testing.assert_array_equal(page._bodies["7"].frame.pose[:3, 3], [1.0, 2.0, 0.5])
        assert [name for name, body in page._bodies.items() if body is not before[name]] == ["7"]
        assert page.view.bodies._made == made
        page.edit(lambda: page.place_body(np.full((4, 4), np.nan)), "drag")
        wait_until(lambda: page.idle)
        np.testing.assert_array_equal(page._bodies["7"].frame.pose[:3, 3], [1.0, 2.0, 0.5])


def test_the_call_for_a_body_of_several_shapes_keeps_them(tmp_path: Path) -> None:
    """The line replaced a table with legs by its top."""
    parts = '<collision><geometry><box size="1 1 0.05"/></geometry></collision>' * 2
    (tmp_path / "table.urdf").write_text(f'<robot name="r"><link name="table">{parts}</link></robot>')
    scene = Scene.of(UR5E, capsules=0.05)
    scene.add_file(tmp_path / "table.urdf")
    before = drawn_bodies(scene)
    scene._place("table", kinseek.pose([2.0, 0.0, 0.0]))
    (line,) = words.changes_of(before, drawn_bodies(scene))
    assert line.startswith("scene.add('table', ..., kinseek.pose([2.0, 0.0, 0.0]")
    with pytest.raises(kinseek.InvalidScene, match=r"expected a Box, .* got ellipsis"):
        exec(line, {"scene": scene, "kinseek": kinseek})


def test_a_visitor_edits_a_scene_of_their_own(page: Any, session: Session) -> None:
    goal(page, FREE)
    page.add_box()
    assert page._selected == "box 1"
    assert page.view.body.visible
    wait_until(lambda: page.idle)
    page.resize_box((0.1, 0.2, 0.3))
    page.place_body(UR5E.fk(page.result.q))
    wait_until(lambda: page.idle)
    np.testing.assert_array_equal(boxes(page)["box 1"], [0.1, 0.2, 0.3])
    # It stands where the hand was, and nothing is free there.
    assert page.result.blocked
    assert "box 1" in page.panel.hits.content
    frame = page.view.body
    np.testing.assert_allclose(frame.position, FREE[:3, 3], atol=1e-5)
    assert page.panel.box_size.value == (0.1, 0.2, 0.3)
    shown = page.panel.changes.content
    assert "scene.add_box(&#x27;box 1&#x27;, [0.1, 0.2, 0.3], kinseek.pose([0.45, -0.3, 0.35]" in shown
    assert session.scene is not page.scene
    assert session.scene is not None
    assert "box 1" not in session.scene.bodies
    page.remove_body()
    wait_until(lambda: page.idle)
    assert page.result.reached
    assert page.panel.changes.content == words.code_html()
    page.remove_body()  # Nothing is selected.
    page.place_body(FREE)
    page.resize_box((0.1, 0.1, 0.1))
    assert set(boxes(page)) == {EVIL}


def test_a_body_that_moves_keeps_its_3d_objects_and_one_that_changes_does_not(page: Any) -> None:
    page.select_body(EVIL)
    before = page.view.bodies._drawn[EVIL]
    page.place_body(kinseek.pose([2.0, 0.0, 0.3]))
    wait_until(lambda: page.idle)
    drawn = page.view.bodies._drawn[EVIL]
    assert drawn.mesh is before.mesh
    np.testing.assert_allclose(drawn.frame.position, [2.0, 0.0, 0.3])
    page.resize_box((0.1, 0.1, 0.1))
    assert page.view.bodies._drawn[EVIL].mesh is not before.mesh
    before.frame.remove.assert_called_once()


def test_bodies_of_files_move_as_a_whole_and_only_boxes_are_resized(page: Any, tmp_path: Any) -> None:
    file = tmp_path / "two.scene"
    one = "sphere\n0.1\n{} 0 0\n0 0 0 1\n0 0 0 0\n"
    file.write_text(
        f"two\n* pair\n0 0 1\n0 0 0 1\n2\n{one.format(0.5)}{one.format(0.9)}0\n.\n", encoding="utf-8"
    )
    page._session.scene = page._session.edited(lambda scene: scene.add_file(file))
    page._edit("pair", lambda scene: None)
    page.place_body(kinseek.pose([3.0, 0.0, 1.0], rpy=[0.0, 0.0, np.pi / 2]))
    page.resize_box((0.1, 0.1, 0.1))
    wait_until(lambda: page.idle)
    body = page.scene._bodies["pair"]
    places = [(body.frame.pose @ part.pose)[:3, 3] for part in body.parts]
    np.testing.assert_allclose(places, [[3.0, 0.0, 1.0], [3.0, 0.4, 1.0]], atol=1e-12)
    assert "scene.add(&#x27;pair&#x27;, ..., kinseek.pose([3.0, 0.0, 1.0]" in page.panel.changes.content


@pytest.mark.parametrize("tracked", [False, True])
def test_numbers_that_are_refused_for_a_body_do_not_stay(tracked: bool, page: Any) -> None:
    """They stayed in its fields, and the refusal in place of the status of a tracker, after other changes."""
    page.edit(page.add_box)
    wait_until(lambda: page._editor.idle and page._selected != "")
    page.servo(tracked)
    wait_until(lambda: page.panel.servo.value == tracked)
    size = page.panel.box_size.value
    page.panel.box_size.value = (0.0, 0.1, 0.1)
    page.edit(lambda: page.resize_box((0.0, 0.1, 0.1)))
    wait_until(lambda: "above 0 m" in page.panel.result.content)
    wait_until(lambda: page._editor.idle)
    assert page.panel.box_size.value == size
    page.edit(lambda: page.resize_box((0.2, 0.1, 0.1)))
    wait_until(lambda: page._editor.idle and "above 0 m" not in page.panel.result.content)
    assert page.panel.box_size.value == (0.2, 0.1, 0.1)


def test_what_cannot_be_edited_says_so_and_changes_nothing(page: Any) -> None:
    from kinseek.viewer.page import MOST_ADDED

    for name in ("forearm_link", "nothing of this name"):
        page.select_body(name)
        assert page._selected == ""
    page.select_body(EVIL)
    scene = page.scene
    for size in ((0.0, 1.0, 1.0), (1e9, 1.0, 1.0), (np.nan, 1.0, 1.0)):
        with pytest.raises(kinseek.InvalidScene):
            page.resize_box(size)
    with pytest.raises(kinseek.InvalidGoal, match="must lie within"):
        page.place_body(kinseek.pose([1e9, 0.0, 0.0]))
    assert page.scene is scene
    for _ in range(MOST_ADDED):
        page.add_box()
    with pytest.raises(kinseek.InvalidScene, match="at most 50"):
        page.add_box()
    wait_until(lambda: page.idle)


def test_labels_of_bodies_are_short_printable_and_different(page: Any) -> None:
    names = [EVIL, "none", "x" * 300, "x" * 300 + "y", "x" * 100]
    page.panel.show_bodies(names, None)
    labels = page.panel.body.options
    assert labels[:2] == ("none", "<b>wall</b>\\n\\u202e")
    assert len(set(labels)) == len(names) + 1
    assert all(label.isprintable() and len(label) < 120 for label in labels)
    assert list(page.panel._labels.values()) == names


def test_a_client_edits_the_scene_and_odd_values_print_nothing(capfd: pytest.CaptureFixture[str]) -> None:
    viser = pytest.importorskip("viser")
    msgspec = pytest.importorskip("msgspec")
    from websockets import Subprotocol
    from websockets.sync.client import connect

    def send(**fields: Any) -> None:
        one.send(msgspec.msgpack.encode(fields))

    def update(handle: Any, value: Any) -> None:
        send(type="GuiUpdateMessage", uuid=handle._impl.uuid, updates={"value": value})

    with viewer.show(UR5E, scene=cell(), port=0, open_browser=False, block=False) as shown:
        capfd.readouterr()
        address = f"ws://127.0.0.1:{shown.port}"
        with connect(
            address, subprotocols=[Subprotocol(f"viser-v{viser.__version__}")], max_size=None
        ) as one:
            send(**CAMERA)
            wait_until(lambda: shown.pages)
            (page,) = shown.pages.values()
            wait_until(lambda: page.idle)
            update(page.panel.body, page.panel.body.options[1])
            wait_until(lambda: page._selected == EVIL)
            dragged = {
                "type": "TransformControlsUpdateMessage",
                "name": "/chosen",
                "wxyz": [1.0, 0.0, 0.0, 0.0],
            }
            dragged["owner"] = page._client.scene._owner_id
            send(**dragged, position=[1e9, 0.0, 0.0])
            send(**dragged, position=[0.5, 0.5, 0.25])
            wait_until(lambda: np.allclose(page._bodies[EVIL].frame.pose[:3, 3], [0.5, 0.5, 0.25]))
            wait_until(lambda: page.idle)
            update(page.panel.box_size, [0.0, -1.0, 1e9])
            wait_until(lambda: "must be 3 lengths above 0 m" in page.panel.result.content)
            update(page.panel.body, "nowhere")
            update(page.panel.box_size, [0.3, 0.2, 0.1])
            wait_until(lambda: np.allclose(boxes(page)[EVIL], [0.3, 0.2, 0.1]))
            wait_until(lambda: page.idle)
            assert page.panel.body.value == page.panel.body.options[1]
    assert capfd.readouterr() == ("", "")


BEHIND = kinseek.pose([0.45, 0.3, 0.35], rpy=[np.pi, 0.0, 0.0])


def test_a_plan_leads_around_the_bodies(session: Session) -> None:
    scene = session.scene
    assert scene is not None
    q0 = UR5E.ik(FREE, scene=scene).require().q
    planned = session.plan(session.begin.but(target=BEHIND), q0, 10.0, lambda: False)
    motion = planned.motion
    assert motion is not None
    assert planned.news == "good"
    assert f"{motion.duration:.2f} s, proved free" in planned.said
    np.testing.assert_allclose(motion.q(0.0), q0)
    np.testing.assert_allclose(UR5E.fk(motion.q(motion.duration)), BEHIND, atol=1e-5)
    assert scene.free(motion.q(np.linspace(0.0, motion.duration, 2000))).all()
    assert (np.abs(motion.velocity(np.linspace(0.0, motion.duration, 100))) <= UR5E.velocity + 1e-9).all()
    swept = session.swept(motion)
    assert swept.free.all()
    assert swept.hit == ()
    np.testing.assert_allclose([swept.places[0], swept.places[-1]], [FREE[:3, 3], BEHIND[:3, 3]], atol=1e-5)
    np.testing.assert_allclose([swept.q[0], swept.q[-1]], [q0, motion.q(motion.duration)])


def test_a_plan_that_is_not_found_says_why(session: Session) -> None:
    scene = session.scene
    assert scene is not None
    q0, begin = UR5E.ik(FREE, scene=scene).require().q, session.begin

    def plan(target: Any, start: Any = q0, stopped: Any = lambda: False) -> Any:
        return session.plan(begin.but(target=target), start, 10.0, stopped)

    blocked = plan(INSIDE)
    assert blocked.motion is None
    assert blocked.news == "bad"
    assert "Proved blocked" in blocked.said
    assert "wall" in blocked.said
    assert "&lt;b&gt;wall" in words.plan_html(blocked)
    away = plan(kinseek.pose([3.0, 0.0, 0.3]))
    assert away.motion is None
    assert away.said.startswith(f"No motion. {Status.BEST_EFFORT} It is off by 2.07 m")
    hit = plan(FREE, UR5E.ik(INSIDE).q)
    assert hit.news == "refused"
    assert "q0 is in collision" in hit.said
    assert plan(FREE).said.startswith("The arm is at the goal") or plan(FREE).motion is not None


def test_a_plan_ends_when_its_time_is_up_or_nobody_wants_it(monkeypatch: pytest.MonkeyPatch) -> None:
    arm = kinseek.Arm.from_dh([[0.4, 0, 0, 0], [0.4, 0, 0, 0]], [-3, -3], [3, 3])
    scene = Scene.of(arm, capsules=0.01)
    scene.add_box("fence", (0.3, 0.01, 0.3), kinseek.pose([0.3, 0.0, 0.0]))
    session = Session(arm, scene)
    options, start = session.begin.but(target=arm.fk([1.0, 0.0])), np.array([-1.0, 0.0])
    monkeypatch.setattr("kinseek.viewer.session.PLAN_PATIENCE", 0.3)
    out_of_time = session.plan(options, start, 10.0, lambda: False)
    monkeypatch.setattr("kinseek.viewer.session.PLAN_PATIENCE", 60.0)
    began = time.monotonic()
    stopped = session.plan(options, start, 10.0, lambda: time.monotonic() > began + 0.3)
    assert time.monotonic() - began < 3.0
    for planned in (out_of_time, stopped):
        assert planned.motion is None
        assert planned.news == "open"
        assert planned.said.startswith("No way was found within the time limit, which does not prove")


def planned_motion(page: Any) -> Any:
    """Return the motion that the page plans from one goal to another."""
    goal(page, FREE)
    page.plan(True)
    wait_until(lambda: page.idle)
    goal(page, BEHIND)
    return page.trajectory


def test_the_page_plans_to_every_goal_and_plays_the_motion(page: Any) -> None:
    motion = planned_motion(page)
    assert motion is not None
    assert page.panel.time.visible
    assert page.panel.time.max >= motion.duration
    assert "proved free" in page.panel.plan.content
    np.testing.assert_allclose(motion.q(0.0), page._start)
    page.choose_time(0.5 * motion.duration)
    wait_until(lambda: page.idle)
    np.testing.assert_array_equal(page.options.q, motion.q(0.5 * motion.duration))
    assert page.panel.hits.content == ""
    assert "on its motion" in page.panel.result.content
    # A box across the way: the motion leads around it, or is no longer offered.
    page.add_box()
    page.place_body(UR5E.fk(motion.q(0.5 * motion.duration)))
    wait_until(lambda: page.idle)
    assert page.trajectory is not motion
    if page.trajectory is not None:
        assert page.scene.free(page.trajectory.q(np.linspace(0.0, page.trajectory.duration, 500))).all()
    goal(page, INSIDE)
    assert page.trajectory is None
    assert not page.panel.time.visible
    assert "data-status='bad'" in page.panel.plan.content
    page.plan(False)
    wait_until(lambda: page.idle)
    assert page.panel.plan.content == ""


def test_a_planned_motion_keeps_the_limits_of_now(page: Any) -> None:
    quick = planned_motion(page).duration
    page.panel._choose_limit("acceleration", 1.0)
    wait_until(lambda: page.idle)
    assert page.trajectory.duration > 2.0 * quick


def test_a_proof_does_not_move_the_arm_away_from_its_motion(page: Any) -> None:
    motion = planned_motion(page)
    result = page.result
    page.choose_time(0.5 * motion.duration)
    wait_until(lambda: page._player.idle)
    assert not page._report_once(result, None, looking=False)
    page._nearer(result, Proof(UR5E.prove(page.options.target)))
    np.testing.assert_array_equal(page.options.q, motion.q(0.5 * motion.duration))
    assert "on its motion" in page.panel.result.content


def test_a_thin_body_on_a_long_motion_is_hit() -> None:
    """It was checked at 400 moments, and a pole of 4 mm was between two of them."""
    scene = Scene.of(UR5E, capsules=0.03)
    scene.add_box("pole", (0.004, 0.004, 2.0), kinseek.pose([0.78, 0.0, 0.0]))
    first = np.array([-3.0, -0.3, 0.3, 0.0, 0.0, 0.0])
    pans = [*[-3.0, -0.5] * 7, -3.0, 3.0]
    rows = np.concatenate([np.linspace(a, b, 60)[:-1] for a, b in itertools.pairwise(pans)])
    q = np.column_stack([rows, np.tile(first[1:], (len(rows), 1))])
    motion = UR5E.follow(UR5E.fk(q), start=first).timed(2.0, 5.0)
    swept = Session(UR5E, scene).swept(motion)
    hits = ~scene.free(motion.q(np.linspace(0.0, motion.duration, 100_000)))
    assert 0 < hits.mean() < 0.01
    assert "pole" in swept.hit
    assert 0 < (~swept.free).sum() < 10


def test_a_newer_goal_ends_a_plan(page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    goal(page, FREE)
    seen: list[bool] = []
    real = page._session.plan

    def slow(options: Any, start: Any, acceleration: float, stopped: Callable[[], bool]) -> Any:
        seen.append(np.allclose(options.target, BEHIND))
        end = time.monotonic() + 5.0
        while seen == [False] and not stopped() and time.monotonic() < end:
            time.sleep(0.005)
        return real(options, start, acceleration, stopped)

    monkeypatch.setattr(page._session, "plan", slow)
    page.plan(True)
    wait_until(lambda: seen)
    began = time.monotonic()
    goal(page, BEHIND)
    assert time.monotonic() - began < 4.0
    assert seen == [False, True]
    assert page.trajectory is not None


def test_a_motion_that_hits_something_is_red_there_and_says_so(session: Session) -> None:
    pytest.importorskip("viser")
    q = UR5E.ik(FREE).q + np.linspace(0.0, 1.2, 30)[:, None] * [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    through = UR5E.follow(UR5E.fk(q), start=q[0]).timed(acceleration=5.0)
    browser = client()
    with page_of(session, through, browser) as page:
        assert "The motion hits &lt;b&gt;wall" in page.panel.plan.content
        (line,) = browser.scene.add_line_segments.call_args_list[1:]
        points, colours = line.args[1:3]
        red = (colours[:, 0] == [214, 40, 40]).all(axis=1)
        assert page.scene is not None
        free = page.scene.free(through.q(np.linspace(0.0, through.duration, len(points) + 1)))
        assert red[~(free[1:] & free[:-1])].all()
        assert red.sum() <= (~(free[1:] & free[:-1])).sum() + 2  # A way may touch between two places.
        assert 0 < red.sum() < len(red)


def test_the_branch_of_a_blocked_goal_is_the_one_that_is_drawn() -> None:
    """After the proof the arm stood at another branch than the one that was named."""
    rng = np.random.default_rng(0)
    scene = Scene.of(UR5E, capsules=0.05)
    for i in range(130):
        scene.add_box(f"b{i}", [0.08] * 3, kinseek.pose(rng.uniform([-0.8, -0.8, -0.5], [0.8, 0.8, 1.1])))
    session, moved = Session(UR5E, scene), 0
    with page_of(session) as page:
        for seed in range(40):
            page.change(target=UR5E.fk(UR5E.sample(1, seed)[0]))
            wait_until(lambda: page.idle, 60.0)
            if not page.result.blocked:
                continue
            moved += np.abs(session.solve(page.options).q - page.result.q).max() > 0.1
            number = nearest_of(page.branches, page.result.q)
            assert f"Branch {number + 1} of {len(page.branches)}" in page.panel.branches.content
            np.testing.assert_array_equal(page.options.q, page.result.q)
            if moved > 2:
                break
        assert moved


def test_the_arm_begins_a_motion_that_is_planned_again(page: Any) -> None:
    """It stayed where the motion before was, with the status of the new one."""
    motion = planned_motion(page)
    page.choose_time(0.5 * motion.duration)
    wait_until(lambda: page.idle)
    page.panel._choose_limit("acceleration", 1.0)
    wait_until(lambda: page.idle)
    assert page.trajectory.duration > motion.duration
    assert page.panel.time.value == 0.0
    np.testing.assert_array_equal(page.options.q, page.trajectory.q(0.0))


def test_no_plan_is_shown_while_the_goal_drives_the_arm(page: Any) -> None:
    planned_motion(page)
    page.servo(True)
    wait_until(lambda: page._planner.idle and page.trajectory is None)
    assert page.panel.plan.content == ""
    page.servo(False)
    wait_until(lambda: page.idle)
    assert page.trajectory is not None
    assert "A motion of" in page.panel.plan.content


def test_a_change_of_the_scene_is_solved_also_while_the_arm_is_on_its_motion(
    page: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A solution that took longer than the quiet time was dropped, and the arm stayed on its motion."""
    motion, solve = planned_motion(page), page._session.solve
    page.choose_time(0.5 * motion.duration)
    wait_until(lambda: page.idle)

    def slow(options: Any) -> Any:
        time.sleep(0.5)
        return solve(options)

    monkeypatch.setattr(type(page._session), "solve", lambda session, options: slow(options))
    page.edit(page.add_box)
    wait_until(lambda: page.idle)
    assert page.result.solution is not None


def test_play_and_stop_keep_the_goal_that_is_solved(page: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    planned_motion(page)
    with page._solver._changed, page._player._changed:  # Both begin after the clicks.
        page.change(target=FREE)
        page.play_motion(True)
        page.play_motion(False)
    wait_until(lambda: page.idle)
    assert page.result.reached
    np.testing.assert_array_equal(page.result.options.target, page.options.target)


def test_the_time_of_a_given_motion_stays_when_the_scene_has_changed() -> None:
    """The slider went back to 0 when the motion was drawn again."""
    scene = Scene.of(UR5E, capsules=0.05)
    motion = UR5E.move(UR5E.sample(2, seed=3)[0], UR5E.sample(2, seed=3)[1], 1.0, 1.0)
    with page_of(Session(UR5E, scene), motion) as page:
        page.edit(page.add_box)
        wait_until(lambda: page._editor.idle and page._solver.idle)
        page.choose_time(0.3)
        wait_until(lambda: page.idle)
        assert page.panel.time.value == 0.3
        np.testing.assert_array_equal(page.options.q, motion.q(0.3))
        page.play_motion(True)
        page.pick(1)
        wait_until(lambda: page.idle)
        assert page.result.reached
        assert nearest_of(page.branches, page.result.q) == 1
