"""The viewer without a browser: what is asked and answered, what is drawn, where it listens."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
import kinseek.viewer
from kinseek import Arm, InvalidSolver, InvalidUse, Status
from kinseek.robots.packages import mesh_path
from kinseek.viewer import clouds, words
from kinseek.viewer.door import is_loopback
from kinseek.viewer.drawing import Figure, between
from kinseek.viewer.meshes import meshes_of
from kinseek.viewer.options import COUNTS, ViewerOptions, read_selection
from kinseek.viewer.searches import PARAMETERS, SEARCHES, make_search, parameters_of
from kinseek.viewer.server import Viewer, free_port
from kinseek.viewer.session import GoalResult, Proof, Session, beginning, nearest_of, status_of
from kinseek.viewer.view import View
from kinseek.viewer.workers import MOST_WAITING, Newest, Queue, Turns
from viewer_pages import KINDS, client, far, function_arm, wait_until


@pytest.fixture(scope="module")
def sessions() -> dict[str, Session]:
    return {name: Session(kinseek.load(name)) for name in KINDS}


@pytest.mark.parametrize("name", KINDS)
def test_a_page_begins_with_a_goal_that_is_reached(name: str, sessions: dict[str, Session]) -> None:
    session = sessions[name]
    result = session.solve(session.begin)
    assert result.reached
    assert status_of(result, None) == (str(Status.SOLVED), "good")
    branches = session.branches(session.begin)
    assert not isinstance(branches, str)
    shown = nearest_of(branches, result.q)
    assert branches.sampled or np.allclose(
        session.arm.fk(branches[shown])[:3, 3], session.begin.target[:3, 3]
    )


@pytest.mark.parametrize("name", KINDS)
def test_out_of_reach_says_what_is_proved(name: str, sessions: dict[str, Session]) -> None:
    session = sessions[name]
    options = far(session.begin)
    result = session.solve(options)
    assert not result.reached
    assert status_of(result, None)[1] == "open"
    proofs = session.proofs(options, lambda: False)
    proof = next(each for each in proofs if each.certificate and each.certificate.lower_bound > 0.01)
    assert proof.unreachable
    assert status_of(result, proof) == (str(Status.PROVED_UNREACHABLE), "bad")
    assert proof.certificate is not None
    assert proof.certificate.lower_bound > 0.01
    assert f"{proof.certificate.lower_bound:.4g}" in " ".join(proof.sentences())


@pytest.mark.parametrize(
    "free", [("x",), ("z", "rz"), ("rx", "ry"), ("x", "y", "rz"), ("x", "rx", "ry", "rz")]
)
def test_a_missed_goal_with_free_axes_is_proved_in_words(free: tuple[str, ...]) -> None:
    """Each rest of the goal printed a traceback, and the page waited for a proof for ever."""
    session = Session(kinseek.load("ur5e"))
    options = session.begin.but(target=kinseek.pose([4.0, 4.0, 5.0], rpy=[0.1, 0.2, 0.3]), free=free)
    assert not session.solve(options).reached
    began = time.monotonic()
    for proof in session.proofs(options, lambda: time.monotonic() > began + 1.0):
        said = " ".join(proof.sentences())
        assert "Proved: every pose has a weighted error of at least" in said
        assert {"x", "y", "z"}.isdisjoint(free) or "whatever its orientation" not in said


def test_a_proof_ends_when_it_is_no_longer_wanted(sessions: dict[str, Session]) -> None:
    session = sessions["atlas_torso_arm"]
    began = time.monotonic()
    *_, proof = session.proofs(far(session.begin), lambda: time.monotonic() > began + 0.3)
    assert time.monotonic() - began < 3.0
    assert proof.certificate is not None
    assert proof.certificate.out_of_time


def test_a_goal_that_cannot_be_asked_is_said_and_the_arm_stays(sessions: dict[str, Session]) -> None:
    session = sessions["ur5e"]
    result = session.solve(session.begin.but(free=("x", "y", "z", "rx", "ry", "rz")))
    assert not result.reached
    assert result.solution is None
    assert status_of(result, None)[1] == "refused"
    assert np.array_equal(result.q, session.begin.q)


def test_a_goal_in_other_units_is_said(sessions: dict[str, Session]) -> None:
    begin = sessions["ur5e"].begin
    target = begin.target.copy()
    target[:3, 3] *= 1000.0
    options = begin.but(target=target)
    result = sessions["ur5e"].solve(options)
    assert "lengths are in metres" in result.refused
    assert "lengths are in metres" in str(sessions["ur5e"].branches(options))
    assert sessions["ur5e"].traced(result) is None
    assert np.array_equal(result.q, begin.q)


def test_goals_with_free_axes_are_proved_and_have_branches(sessions: dict[str, Session]) -> None:
    session = sessions["ur5e"]
    far_off = far(session.begin).but(free=("rx",))
    *_, last = session.proofs(far_off, lambda: False)
    assert last.unreachable
    branches = session.branches(session.begin.but(free=("z", "rx")))
    assert not isinstance(branches, str)
    assert len(branches) > 1


def test_picking_a_branch_shows_it_and_the_next_answer_stays_near(sessions: dict[str, Session]) -> None:
    session = sessions["ur5e"]
    branches = session.branches(session.begin)
    assert not isinstance(branches, str)
    assert len(branches) > 1
    for number, q in enumerate(branches):
        picked = session.picked(session.begin, q)
        assert nearest_of(branches, picked.q) == number
        assert picked.call == "arm.ik(T, near=q)"
        np.testing.assert_array_equal(picked.near, q)
        moved = picked.options.target.copy()
        moved[0, 3] += 1e-3
        again = session.solve(picked.options.but(target=moved))
        assert np.abs(again.q - picked.q).max() < 0.1


def test_a_branch_of_a_goal_that_has_changed_since_is_refused(sessions: dict[str, Session]) -> None:
    session = sessions["ur5e"]
    q = session.solve(session.begin).q
    picked = session.picked(session.begin.but(free=("x", "y", "z", "rx", "ry", "rz")), q)
    assert "free" in picked.refused
    assert picked.solution is None


@pytest.mark.parametrize("search", SEARCHES)
def test_every_search_answers_or_says_why_not(search: str, sessions: dict[str, Session]) -> None:
    session = sessions["scara4"]
    options = session.begin.but(search=search)
    assert set(parameters_of(search)) <= set(PARAMETERS)
    result = session.solve(options)
    assert result.solution is not None
    assert result.solution.position_error < 0.2
    trace = result.trace or session.traced(result)
    assert trace is not None
    assert len(trace)
    for number, one in enumerate(trace):
        assert clouds.visited(session.arm, one).shape[1] == 3
        assert one.name in words.pass_html(trace, number)
    assert trace.evaluations[-1] == result.solution.evaluations
    told = eval(result.call, {"arm": session.arm, "kinseek": kinseek, "T": options.target, "q": result.near})
    assert np.array_equal(told.q, result.q)


def test_parameters_are_read_from_text() -> None:
    given = {"branching_factor": "720", "divisions": "5", "breadth": "2,1,1", "tree": "static", "beam": "4"}
    search: Any = make_search("DivideAndConquer", given)
    assert (search.branching_factor, search.divisions, search.breadth) == (720, 5, (2, 1, 1))
    tuned: Any = make_search("DivideAndConquer", given | {"breadth": "tuned"})
    assert tuned.breadth == "tuned"
    mixed: Any = make_search("DivideAndConquer", given | {"breadth": "2.5"})
    assert mixed.breadth == 2.5
    for name, text in (
        ("divisions", "many"),
        ("breadth", ""),
        ("tree", "oak"),
        ("branching_factor", "1.5"),
        ("beam", "1,2"),
    ):
        with pytest.raises(InvalidSolver, match="expected"):
            make_search("DivideAndConquer", given | {name: text})


@pytest.mark.parametrize("search", ["DivideAndConquer", "BruteForce"])
def test_a_page_cannot_ask_for_gigabytes_of_nodes(search: str) -> None:
    with pytest.raises(InvalidSolver, match="the page takes at most 100,000, got 20,000,000"):
        make_search(search, {"branching_factor": "20000000"})


def test_what_a_browser_keeps_comes_back(sessions: dict[str, Session]) -> None:
    begin = sessions["ur5e"].begin
    kept = begin.but(
        free=["rz"],
        search="DivideAndConquer",
        samples=True,
        dark=True,
        camera=((1.0, 2.0, 3.0), (0.0, 0.0, 0.5)),
    )
    back = read_selection(kept.to_json(), begin)
    for name in ViewerOptions.__dataclass_fields__:
        assert np.array_equal(getattr(back, name), getattr(kept, name)), name


@pytest.mark.parametrize(
    "damage",
    [
        {"version": 0},
        {"target": [[1, 2], [3, 4]]},
        {"target": [[2, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]},
        {"q": [1.0]},
        {"q": [float("nan")] * 6},
        {"q": [1e308] * 6},
        {"q": [-2e7] * 6},
        {"free": 7},
        {"search": "Oracle"},
        {"search": "DivideAndConquer", "parameters": {"divisions": "<b>"}},
        {"camera": [[0, 0, 0], [0, 0, 0]]},
        {"camera": [[1e308, 0, 0], [0, 0, 0]]},
        {"camera": "here"},
    ],
)
def test_what_a_browser_kept_may_be_anything(damage: dict[str, Any], sessions: dict[str, Session]) -> None:
    begin = sessions["ur5e"].begin
    values = json.loads(begin.to_json()) | damage
    back = read_selection(json.dumps(values), begin)
    assert sessions["ur5e"].solve(back).reached
    assert np.abs(back.q).max() <= 1e7
    assert back.camera is None
    assert read_selection("[1, 2", begin) is read_selection(None, begin) is begin


def test_an_arm_that_is_a_function_does_what_it_can() -> None:
    session = Session(function_arm())
    result = session.solve(session.begin)
    assert result.reached
    assert len(clouds.samples_around(session.arm, session.begin).points)
    (proof,) = session.proofs(far(session.begin), lambda: False)
    assert proof.sentences() == ["Nothing can be proved about an arm with black-box kinematics."]
    assert isinstance(clouds.boxes_left(session.arm, far(session.begin), result.q, 100), str)
    html = words.joints_html(session.arm, result.q)
    assert "data-joints='2'" in html
    assert not meshes_of(session.arm.axes).links


@pytest.mark.parametrize("name", KINDS)
def test_rods_go_from_joint_to_joint(name: str) -> None:
    arm = kinseek.load(name)
    figure, q = Figure(arm.chain), arm.sample(3)
    rods = figure.draw(q)
    turn = np.stack(
        [
            2 * (rods.wxyz[..., 1] * rods.wxyz[..., 3] + rods.wxyz[..., 0] * rods.wxyz[..., 2]),
            2 * (rods.wxyz[..., 2] * rods.wxyz[..., 3] - rods.wxyz[..., 0] * rods.wxyz[..., 1]),
            1 - 2 * (rods.wxyz[..., 1] ** 2 + rods.wxyz[..., 2] ** 2),
        ],
        axis=-1,
    )
    ends = rods.start + turn * rods.scale[..., 2:]
    tips = arm.fk(q)[:, :3, 3]
    assert np.allclose(ends[:, figure.links - 1], tips, atol=1e-5)
    assert np.allclose(rods.start[:, 0], 0.0)
    from kinseek.robots.chain import joint_points

    for k in range(3):  # Every point that pictures know is the end of a rod.
        for point in joint_points(arm.chain, q[k]):
            near = min(
                np.abs(rods.start[k] - point).max(axis=1).min(), np.abs(ends[k] - point).max(axis=1).min()
            )
            assert near < 1e-5


def test_a_rod_straight_down_is_turned_half_around() -> None:
    rods = between(np.zeros((1, 1, 3)), np.array([[[0.0, 0.0, -2.0]]]), np.array([0.1]))
    assert np.allclose(rods.wxyz, [0, 1, 0, 0])
    assert np.allclose(rods.scale, [0.1, 0.1, 2.0])


@pytest.mark.parametrize("name", KINDS)
def test_samples_lie_around_the_goal(name: str, sessions: dict[str, Session]) -> None:
    session = sessions[name]
    cloud = clouds.samples_around(session.arm, session.begin)
    away = np.linalg.norm(cloud.points - session.begin.target[:3, 3], axis=1)
    assert len(cloud.points)
    assert ((cloud.shade >= 0) & (cloud.shade <= 1)).all()
    anywhere = np.linalg.norm(
        session.arm.fk(session.arm.sample(500))[:, :3, 3] - session.begin.target[:3, 3], axis=1
    )
    assert np.median(away) <= 0.5 * np.median(anywhere)


def test_what_is_reachable_grows_can_be_stopped_and_goes_on(sessions: dict[str, Session]) -> None:
    session = sessions["scara4"]
    steps = clouds.reachable(session.arm, session.begin, lambda: False)
    first = next(steps)
    second = next(steps)
    assert first.tried < second.tried
    assert len(first.points) <= len(second.points)
    again = next(clouds.reachable(session.arm, session.begin, lambda: False, first))
    assert again.tried == second.tried
    assert np.array_equal(again.points, second.points)
    assert not list(clouds.reachable(session.arm, session.begin, lambda: True))
    # With a free position axis the tip may be elsewhere, but the cloud is of places of the tip.
    freed = next(clouds.reachable(session.arm, session.begin.but(free=("x", "y")), lambda: False))
    np.testing.assert_array_equal(freed.points, first.points)
    assert 0 < len(second.points) < second.tried
    for point in second.points[:20]:
        target = session.begin.target.copy()
        target[:3, 3] = point
        assert session.solve(session.begin.but(target=target)).reached


def test_the_reachable_region_of_a_slow_arm_ends_soon() -> None:
    """Pages that were closed kept the turns of others for half a minute: one piece was 128 searches."""
    arm, asked = function_arm(), list[bool]()

    def stopped() -> bool:
        asked.append(True)
        return len(asked) > 3

    session = Session(arm)
    tried = [known.tried for known in clouds.reachable(arm, session.begin, stopped)]
    assert tried[0] == 1
    assert len(tried) == 3
    assert tried[-1] <= 7


def test_a_planar_arm_reaches_places_in_its_plane(sessions: dict[str, Session]) -> None:
    session = sessions["planar2"]
    known = next(clouds.reachable(session.arm, session.begin, lambda: False))
    assert len(known.points) > 10


def test_boxes_are_left_until_the_nearest_pose_is_known(sessions: dict[str, Session]) -> None:
    session = sessions["ur5e"]
    options = far(session.begin)
    q = session.solve(options).q
    few, many = (clouds.boxes_left(session.arm, options, q, count) for count in (30, 300))
    assert not isinstance(few, str)
    assert not isinstance(many, str)
    assert 0 < len(few.points) < len(many.points)
    assert "free axes" in str(clouds.boxes_left(session.arm, options.but(free=("x",)), q, 30))


def test_names_from_a_file_are_text_and_no_tags() -> None:
    arm = Arm.from_fk(
        lambda q: np.tile(np.eye(4), (len(q), 1, 1)), [0.0], [1.0], names=["<script>alert(1)</script>"]
    )
    assert "<script>" not in words.joints_html(arm, np.array([0.5]))
    assert "<b>" not in words.note_html("<b>")
    assert "&lt;b&gt;" in words.note_html("<b>")


def test_bars_show_where_a_joint_is(sessions: dict[str, Session]) -> None:
    arm = sessions["cylindrical3"].arm
    html = words.joints_html(arm, arm.lower)
    assert html.count("calc(0.00% - 2px)") == arm.dof
    assert html.count("#e8590c") == sum(kind != "continuous" for kind in arm.kinds)
    assert words.joint(-1e-9, "revolute") == "0.0°"
    assert words.joint(0.0123, "prismatic") == "12.3 mm"


def test_a_window_that_crosses_the_end_goes_on_at_the_other(sessions: dict[str, Session]) -> None:
    session = sessions["ur5e"]
    trace = session.solve(session.begin.but(search="DivideAndConquer")).trace
    assert trace is not None
    bands = [words.joints_html(session.arm, session.begin.q, one).count("rgba(230,119,0") for one in trace]
    assert bands[0] >= session.arm.dof
    assert all(count >= session.arm.dof for count in bands)


def test_counts_have_names() -> None:
    for name, free in COUNTS.items():
        assert ViewerOptions(np.eye(4), np.zeros(2), free).counts == name
    assert ViewerOptions(np.eye(4), np.zeros(2), ("x",)).counts not in COUNTS


# Meshes.

URDF = """<robot name="two"><material name="blue"><color rgba="0 0 1 1"/></material>
<link name="base"><visual><geometry><cylinder radius="0.1" length="0.2"/></geometry></visual></link>
<link name="arm"><visual><origin xyz="0 0 0.5" rpy="0 0 1.5707963"/><geometry><mesh filename="{mesh}" scale="2 2 2"/>
</geometry><material name="blue"/></visual></link>
<link name="hand"><visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual></link>
<link name="camera"><visual><geometry><sphere radius="0.05"/></geometry></visual></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="f" type="fixed"><parent link="arm"/><child link="hand"/><origin xyz="0 0 1"/></joint>
<joint name="c" type="fixed"><parent link="arm"/><child link="camera"/><origin xyz="0.3 0 0"/></joint></robot>"""


@pytest.fixture
def trimesh() -> Any:
    return pytest.importorskip("trimesh")


def written(folder: Path, mesh: str) -> Path:
    path = folder / "two.urdf"
    path.write_text(URDF.format(mesh=mesh))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["stl", "obj", "ply", "glb"])
def test_meshes_are_read_scaled_turned_and_moved(ending: str, tmp_path: Path, trimesh: Any) -> None:
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.export(tmp_path / f"arm.{ending}")
    arm = kinseek.load(written(tmp_path, f"arm.{ending}"), tip="hand")
    found = meshes_of(arm.chain)
    assert not found.missing
    assert len(found.links) == 4  # With the camera, which is fixed to the arm beside the way to the hand.
    sizes = [part.extents for link in found.links for part in link.parts]
    assert any(np.allclose(size, [0.4, 0.2, 0.6], atol=1e-6) for size in sizes)
    heights = [part.bounds[:, 2].mean() for link in found.links for part in link.parts]
    assert any(abs(height - 0.5) < 1e-6 for height in heights)


def test_small_units_of_a_mesh_do_not_change_its_shape(tmp_path: Path, trimesh: Any) -> None:
    """Vertices nearer than 1e-8 in the unit of the file became one before they were scaled."""
    trimesh.creation.box((1e-10, 2e-10, 3e-10)).export(tmp_path / "arm.stl")
    path = written(tmp_path, "arm.stl")
    path.write_text(path.read_text().replace('scale="2 2 2"', 'scale="1e9 1e9 1e9"'))
    found = meshes_of(kinseek.load(path, tip="hand").chain)
    sizes = [part.extents for link in found.links for part in link.parts]
    assert any(np.allclose(size, [0.2, 0.1, 0.3], atol=1e-6) for size in sizes)


def test_meshes_are_those_of_the_arm_that_was_loaded(tmp_path: Path, trimesh: Any) -> None:
    """What a xacro file becomes depends on its arguments; and of text there is no file to read again."""
    package = tmp_path / "away" / "parts"
    package.mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(package / "arm.stl")
    path = tmp_path / "here" / "two.xacro"
    path.parent.mkdir()
    head = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:arg name="size" default="no number"/>'
    text = URDF.format(mesh="package://parts/arm.stl")
    text = re.sub(r"<robot[^>]*>", head, text, count=1).replace('scale="2 2 2"', 'scale="$(arg size) 2 2"')
    assert "arg size" in text
    path.write_text(text)
    given = {"parts": package}
    arm = kinseek.load(path, tip="hand", args={"size": 3}, packages=given)
    path.unlink()
    found = meshes_of(arm.with_limits({"j": (-0.5, 0.5)}).axes)
    assert not found.missing
    sizes = [part.extents for link in found.links for part in link.parts]
    assert any(np.allclose(size, [0.4, 0.3, 0.6], atol=1e-6) for size in sizes)
    arm = kinseek.load(URDF.format(mesh="package://parts/arm.stl"), tip="hand")
    assert "'parts'" in meshes_of(arm.axes).missing[0]
    assert len(meshes_of(arm.axes, given).links) == 4


def test_a_mesh_with_a_broken_image_is_drawn_without_it(tmp_path: Path, trimesh: Any) -> None:
    """Images are decoded while a page is laid out, and the error left every page empty."""
    pytest.importorskip("PIL.Image").effect_noise((64, 64), 50).save(tmp_path / "whole.png")
    (tmp_path / "a.png").write_bytes((tmp_path / "whole.png").read_bytes()[:999])
    (tmp_path / "a.mtl").write_text("newmtl a\nmap_Kd a.png\n")
    faces = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n"
    (tmp_path / "a.obj").write_text(faces)
    path = written(tmp_path, "a.obj")
    path.write_text(path.read_text().replace('<material name="blue"/>', ""))  # It would replace the image.
    arm = kinseek.load(path, tip="hand")
    meshes, drawn = meshes_of(arm.chain), client()
    written_files = list[bytes]()
    # As viser does.
    drawn.scene.add_mesh_trimesh.side_effect = lambda name, mesh: written_files.append(
        mesh.export(file_type="glb")
    )
    View(drawn.scene, arm, meshes, lambda name: None)
    assert len(written_files) == sum(len(link.parts) for link in meshes.links) > 0


def test_all_missing_meshes_are_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    text = re.sub(r"<(box|sphere) [^>]*/>", '<mesh filename="no_\\1.stl"/>', URDF.format(mesh="no_arm.stl"))
    (tmp_path / "three.urdf").write_text(text)
    arm = kinseek.load(tmp_path / "three.urdf", tip="hand")
    kinseek.viewer.show(arm, port=0, open_browser=False, block=False).stop()
    said = capsys.readouterr().out
    assert "Drawn without 3 meshes:" in said
    assert all(f"no_{part}.stl" in said for part in ("arm", "box", "sphere"))
    found = meshes_of(arm.axes)
    found.missing *= 3
    assert found.report() == [*found.missing[:5], "… and 4 more"]


def test_a_missing_mesh_is_named_and_the_rest_is_shown(tmp_path: Path) -> None:
    pytest.importorskip("trimesh")
    found = meshes_of(kinseek.load(written(tmp_path, "package://nowhere/arm.stl"), tip="hand").chain)
    assert len(found.links) == 3
    (said,) = found.missing
    assert "'arm'" in said
    assert "nowhere" in said
    assert "packages=" in said
    (tmp_path / "broken.stl").write_bytes(b"solid nothing of the kind")
    found = meshes_of(kinseek.load(written(tmp_path, "broken.stl"), tip="hand").chain)
    assert len(found.links) == 3
    assert "broken.stl" in found.missing[0]


@pytest.mark.parametrize(
    "shape",
    [
        '<box size="1 1e308 1"/>',
        '<cylinder radius="1e308" length="1"/>',
        '<sphere radius="1e308"/>',
        '<mesh filename="arm.stl" scale="1e308 1 1"/>',
    ],
)
def test_a_shape_too_large_to_compute_with_is_left_out(shape: str, tmp_path: Path, trimesh: Any) -> None:
    """NumPy warned of overflow in the terminal."""
    trimesh.creation.box((10, 10, 10)).export(tmp_path / "arm.stl")
    path = written(tmp_path, "arm.stl")
    path.write_text(re.sub(r"<mesh [^>]*/>", shape, path.read_text()))
    found = meshes_of(kinseek.load(path, tip="hand").chain)
    assert len(found.links) == 3
    assert "cannot be shown, at most 1e+06 m" in found.missing[0]


def test_packages_are_found_as_ros_finds_them(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for folder in ("given/meshes", "ros/two_description/meshes", "ament/share/third/meshes"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "a b.stl").touch()
    robot = tmp_path / "robot" / "x.urdf"
    for name in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH", "COLCON_PREFIX_PATH"):
        monkeypatch.delenv(name, raising=False)
    given = {"one": tmp_path / "given"}
    assert mesh_path("package://one/meshes/a%20b.stl", robot, given) == tmp_path / "given/meshes/a b.stl"
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    assert mesh_path("package://two_description/meshes/a b.stl", robot, {}).is_file()
    assert mesh_path("package://third/meshes/a b.stl", robot, {}).is_file()
    inside = tmp_path / "ros" / "two_description" / "urdf" / "x.urdf"
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    assert mesh_path("package://two_description/meshes/a b.stl", inside, {}).is_file()
    with pytest.raises(kinseek.InvalidRobot, match="neither a path"):
        mesh_path("https://example.org/a.stl", robot, {})


def test_bundled_arms_have_no_meshes_and_nothing_is_said() -> None:
    for name in KINDS:
        found = meshes_of(kinseek.load(name).axes)
        assert not found.links
        assert not found.missing


def test_a_queue_works_in_order_and_drops_what_nobody_can_have_clicked() -> None:
    done, go = list[Any](), threading.Event()

    def work(item: tuple[str, int]) -> None:
        go.wait(10.0)
        done.append(item)

    worker = Queue[int](work, "test")
    worker.give(("", -1))
    wait_until(lambda: not worker._waiting)
    for item in (("", 0), ("drag", 1), ("drag", 2), ("", 3), ("", 4), ("drag", 5)):
        worker.give(item)
    for number in range(100):
        worker.give(("", 100 + number))
    go.set()
    wait_until(lambda: worker.idle)
    worker.close()
    assert done[:6] == [("", -1), ("", 0), ("drag", 2), ("", 3), ("", 4), ("drag", 5)]
    assert len(done) == 1 + MOST_WAITING


def test_slow_work_of_many_pages_takes_turns() -> None:
    """Sixteen pages at once held up the server's loop for 6 s."""
    turns, go = Turns(2), threading.Event()
    begun, lock = list[tuple[int, int]](), threading.Lock()

    def work(item: tuple[int, int]) -> None:
        with lock:
            begun.append(item)
        go.wait(10.0)

    workers = [Newest(work, "test", turn=lambda: turns) for _ in range(5)]
    for number, worker in enumerate(workers):
        worker.give((number, 0))
    wait_until(lambda: len(begun) == 2)
    waiting = [worker for number, worker in enumerate(workers) if (number, 0) not in begun]
    waiting.pop().close()  # It does not wait for its turn.
    for worker in waiting:
        worker.give((workers.index(worker), 1))
    time.sleep(0.3)
    assert len(begun) == 2
    go.set()
    wait_until(lambda: all(worker.idle for worker in waiting))
    for worker in workers:
        worker.close()
    assert sorted(begun[2:]) == sorted((workers.index(worker), 1) for worker in waiting)
    assert turns._free == 2


def test_a_page_that_asks_without_a_pause_waits_for_its_turn() -> None:
    """Two pages that dragged a goal with a slow search kept both turns: a third had no answer in 22 s."""
    turns, done = Turns(2), list[int]()

    def work(number: int) -> None:
        done.append(number)
        if number < 2:
            workers[number].give(number)  # The next one is there before this one ends.
        time.sleep(0.02)

    workers = [Newest(work, "test", turn=lambda: turns) for _ in range(3)]
    for number in (0, 1):
        workers[number].give(number)
    wait_until(lambda: len(done) > 10)
    at = len(done)
    workers[2].give(2)
    wait_until(lambda: 2 in done)
    assert done.index(2) < at + 8
    for worker in workers:
        worker.close()


# Where it listens, and how it works beside the page.


def test_a_port_that_is_taken_gives_the_next_one() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert free_port("127.0.0.1", port) in range(port + 1, port + 100)


@pytest.mark.parametrize("port", [-1, 65536, "8080", True, 1.5])
def test_a_port_is_a_whole_number(port: Any) -> None:
    with pytest.raises(InvalidUse, match="whole number"):
        free_port("127.0.0.1", port)


@pytest.mark.parametrize("host", ["203.0.113.7", "no such host.invalid", "\0", "::ffff:127.0.0.1", ""])
def test_a_host_is_an_address_of_this_machine(host: str) -> None:
    with pytest.raises(InvalidUse, match="host must be"):
        free_port(host, 8080)


def test_only_loopback_is_this_machine_alone() -> None:
    assert is_loopback("127.0.0.1")
    assert is_loopback("::1")
    assert is_loopback("localhost")
    assert not is_loopback("0.0.0.0")
    assert not is_loopback("192.168.0.7")


def test_show_takes_an_arm() -> None:
    from kinseek.viewer import show

    with pytest.raises(InvalidUse, match=r"kinseek\.load"):
        show("panda")  # type: ignore[arg-type]


@pytest.mark.slow
def test_without_viser_the_extra_is_named() -> None:
    code = (
        "import sys; sys.modules['viser'] = None\nimport kinseek\nfrom kinseek.viewer import show\n"
        "try: show(kinseek.load('planar2'))\nexcept kinseek.MissingExtra as error: print(error)"
    )
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "pip install 'kinseek[view]'" in said


def test_a_worker_takes_the_newest_and_outlives_a_fault(caplog: pytest.LogCaptureFixture) -> None:
    done: list[int] = []
    gate, began = threading.Event(), threading.Event()

    def work(number: int) -> None:
        if number == 0:
            began.set()
            gate.wait(5)
        if number == 3:
            raise ValueError("a fault")
        done.append(number)

    worker = Newest(work, "test")
    worker.give(0)
    assert began.wait(5)
    worker.give(1)
    worker.give(2)
    assert worker.stale()
    assert not worker.idle
    gate.set()
    wait_until(lambda: worker.idle)
    assert done == [0, 2]
    worker.give(3)
    wait_until(lambda: worker.idle)
    worker.give(4)
    wait_until(lambda: worker.idle)
    worker.close()
    assert done == [0, 2, 4]
    assert "could not show" in caplog.text


def test_a_worker_waits_until_it_is_quiet() -> None:
    done: list[int] = []
    worker = Newest(done.append, "test", quiet=0.1)
    for number in range(5):
        worker.give(number)
        time.sleep(0.01)
    wait_until(lambda: worker.idle)
    worker.close()
    assert done == [4]


def test_a_worker_waits_too_where_one_wish_is_as_the_other() -> None:
    done: list[str] = []
    worker = Newest(done.append, "test", quiet=0.2)
    for _ in range(5):
        worker.give("again")
        time.sleep(0.02)
    assert done == []
    wait_until(lambda: worker.idle)
    worker.close()
    assert done == ["again"]


def test_a_proof_of_a_goal_that_is_gone_is_not_told() -> None:
    """The last look of a proof ends while the answer to a newer goal is shown."""
    from types import SimpleNamespace

    from kinseek.viewer.page import Page

    session = Session(kinseek.load("planar2"))
    old, new = (GoalResult(session.begin, session.begin.q, refused="") for _ in range(2))
    page: Any = Page.__new__(Page)
    page._lock, page.result, page.proof, page._refusal = threading.RLock(), old, None, ""
    page._prover = SimpleNamespace(stale=lambda: False)
    page.panel = SimpleNamespace(result=SimpleNamespace(content=""), joints=SimpleNamespace(content=""))

    def proofs(options: ViewerOptions, stopped: Any) -> Any:
        yield Proof(refused="not known")
        assert "not known" in page.panel.result.content
        page.result, page.proof, page.panel.result.content = new, None, "of the newer goal"

    page._session = SimpleNamespace(proofs=proofs)
    page._prove("again")
    assert page.panel.result.content == "of the newer goal"
    assert page.proof is None


def test_a_trace_of_a_goal_that_is_gone_is_not_kept() -> None:
    from types import SimpleNamespace

    from kinseek.viewer.page import Page

    session = Session(kinseek.load("planar2"))
    old, new = (session.solve(session.begin) for _ in range(2))
    page: Any = Page.__new__(Page)
    page._lock, page.result, page.trace = threading.RLock(), old, None

    def traced(result: GoalResult) -> Any:
        page.result = new  # It comes while this is being found out.
        return session.traced(result)

    page._session = SimpleNamespace(traced=traced)
    page._find_trace(old)
    assert page.trace is None
    page._find_trace(new)
    assert page.trace is not None


def test_a_page_begins_where_the_arm_is_dexterous() -> None:
    arm = kinseek.load("ur5e")
    q = beginning(arm)
    assert arm.manipulability(q) > np.median(arm.manipulability(arm.sample(64)))


def test_texts_of_an_answer() -> None:
    session = Session(kinseek.load("planar2"))
    html = words.result_html(session.solve(session.begin), None, False)
    assert "data-status='good'" in html
    assert "FK evaluations" in html
    refused = GoalResult(session.begin, session.begin.q, refused="<no>")
    assert "&lt;no&gt;" in words.result_html(refused, None, False)
    assert "looking" in words.branches_html(None, -1, 0)
    assert "No branches" in words.branches_html("none of these", -1, 0)


@pytest.mark.slow
def test_viser_is_quiet_and_other_threads_print_on(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    over = threading.Event()
    printed = []

    def talk() -> None:
        while not over.is_set():
            print("said by another thread")
            printed.append(1)
            time.sleep(0.001)

    talker = threading.Thread(target=talk)
    talker.start()
    try:
        Viewer(kinseek.load("planar2"), port=0).stop()
    finally:
        over.set()
        talker.join()
    told = capsys.readouterr()
    assert told == ("said by another thread\n" * len(printed), "")


def test_a_viewer_is_stopped_if_its_address_cannot_be_printed(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[Viewer] = []

    def announce(one: Viewer, *options: Any) -> None:
        made.append(one)
        raise BrokenPipeError

    monkeypatch.setattr(kinseek.viewer, "_announce", announce)
    with pytest.raises(BrokenPipeError):
        kinseek.viewer.show(kinseek.load("planar2"), port=0, open_browser=False)
    assert made[0]._stopped.is_set()
