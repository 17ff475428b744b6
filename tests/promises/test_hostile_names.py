"""Names in files do nothing to their reader: terminals, notebooks, pictures and pages show escapes, programs the name."""

from __future__ import annotations

import csv
import io
import json
import pickle
import traceback
import unicodedata
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek import Scene
from kinseek.cli.program import run
from kinseek.errors import KinseekError
from kinseek.printable import _INVISIBLE, in_html, printable

IN_XML = "&#x9b;31m&#x202e;&#10;&#9;&#xe000;$\\frac$"
"""A control sequence in one character, text from right to left, a line break, private use, half a formula."""
NAME = "\x9b31m\u202e\n\t\ue000$\\frac$"
SHOWN = r"\x9b31m\u202e\n\t\ue000$\frac$"
OBJECT = "\x1b]0;owned\x07\x9b31m\u202e"
"""Sets the title of a terminal."""

AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
AT = ("--at", "0.1", "0.1", "0.3", "--position-only")
FOLLOW = ("follow", "arm.urdf", "poses.csv", "--position-only", "--acceleration", "5")


def urdf() -> str:
    links = "".join(
        f'<link name="l{i}{IN_XML}"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>'
        for i in range(7)
    )
    joints = "".join(
        f'<joint name="j{i}{IN_XML}" type="revolute"><parent link="l{i}{IN_XML}"/><child link="l{i + 1}{IN_XML}"/>'
        f'<origin xyz="0.1 0 0.1" rpy="0.3 0 0"/><axis xyz="{axis}"/>'
        '<limit lower="-2" upper="2" velocity="1" effort="1"/></joint>'
        for i, axis in enumerate(AXES)
    )
    return f'<robot name="r{IN_XML}">{links}{joints}</robot>'


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf").write_text(urdf(), encoding="utf-8")
    Path("cell.scene").write_text(
        f"a\n* {OBJECT}\n1\nsphere\n5.0\n0 0 0\n0 0 0 1\n0 0 0 0\n.\n", encoding="utf-8"
    )
    Path("poses.csv").write_text("x,y,z,qw,qx,qy,qz\n0.1,0.1,0.3,1,0,0,0\n0.1,0.1,0.31,1,0,0,0\n")
    return tmp_path


def hidden(text: str) -> set[str]:
    """Characters that a terminal would act on, or that nobody would see."""
    return {letter for letter in text if not letter.isprintable() and letter != "\n"}


@pytest.mark.slow
def test_every_such_character_is_escaped_and_no_other() -> None:
    kinds = {chr(number): unicodedata.category(chr(number)) for number in range(0x110000)}
    acting = "".join(letter for letter, kind in kinds.items() if kind[0] == "C" or kind in ("Zl", "Zp"))
    assert printable(acting).isascii()
    without_shape = "\u034f\u115f\u1160\u17b4\u180b\u180f\u2800\u3164\ufe0f\uffa0\U000e0100"
    assert printable(without_shape).isascii()
    assert printable("a\u3164") == "a\\u3164"
    shown = "".join(letter for letter in kinds if letter.isprintable() and letter not in _INVISIBLE)
    assert len(shown) > 100_000
    assert printable(shown) == shown
    assert printable(shown + "\0") == shown + r"\x00"
    assert printable("a\nb\t", keep="\n") == "a\nb\\t"
    assert in_html("<\x1b&") == "&lt;\\x1b&amp;"


@pytest.mark.parametrize(
    "words",
    [
        ("show", "arm.urdf"),
        ("check", "arm.urdf"),
        ("check", "arm.urdf", "--base", "x"),
        ("fk", "arm.urdf", *"000000"),
        ("fk", "arm.urdf", "0"),
        ("solve", "arm.urdf", *AT),
        ("solve", "arm.urdf", *AT, "--all"),
        ("solve", "arm.urdf", *AT, "--trace"),
        ("solve", "arm.urdf", *AT, "--near", "x=1"),
        ("solve", "arm.urdf", *AT, "--tip", "x"),
        ("solve", "arm.urdf", *AT, "--lock", f"j0{NAME}=0"),
        ("solve", "arm.urdf", *AT, "--scene", "cell.scene"),
        ("solve", "arm.urdf", "--batch", "poses.csv", "--out", "out.csv"),
        ("follow", "arm.urdf", "poses.csv", "out.csv"),
        ("follow", "arm.urdf", "poses.csv", "out.csv", "--scene", "cell.scene"),
        ("follow", "arm.urdf", "poses.csv", "--out", "out.csv"),
        (*FOLLOW, "--out", "out.src"),
        (*FOLLOW, "--out", "out.script", "--acceleration", f"j0{NAME}=1"),
        ("map", "arm.urdf", "--estimate", "--step", "0.2"),
        ("\x1b]0;owned\x07",),
        ("show", "\x1b]0;owned\x07.urdf"),
    ],
)
@pytest.mark.slow
def test_no_command_prints_them(
    words: tuple[str, ...], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "--scene" in words:
        pytest.importorskip("pinocchio")
    assert run(words) in (0, 1, 2)
    out, err = capsys.readouterr()
    assert out + err
    assert hidden(out + err) == set()


@pytest.mark.slow
def test_a_program_for_a_robot_has_them_in_comments_alone(folder: Path) -> None:
    assert run([*FOLLOW, "--out", "out.src"]) == 0
    lines = Path("out.src").read_bytes().decode("ascii").split("\r\n")
    assert f"; A1: j0{SHOWN}" in lines
    assert hidden("".join(lines)) == set()
    assert not [line for line in lines if "j0" in line and not line.startswith(";")]


@pytest.mark.slow
def test_a_table_keeps_its_rows(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["show", "arm.urdf"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines[2:8]] == [f"j{i}{SHOWN}" for i in range(6)]


@pytest.mark.slow
def test_programs_get_the_names_as_they_are(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pinocchio")
    names = [f"j{i}{NAME}" for i in range(6)]
    assert list(kinseek.load("arm.urdf").joint_names) == names
    run(["solve", "arm.urdf", *AT, "--scene", "cell.scene", "--json"])
    told = json.loads(capsys.readouterr().out)
    assert told["joint_names"] == names
    assert OBJECT in {contact["b"] for contact in told["contacts"]}
    assert run(["solve", "arm.urdf", "--batch", "poses.csv", "--out", "out.csv"]) in (0, 1)
    with open("out.csv", encoding="utf-8", newline="") as file:
        assert set(names) <= set(next(csv.reader(file)))


def test_what_python_prints(folder: Path) -> None:
    pytest.importorskip("pinocchio")
    arm = kinseek.load("arm.urdf")
    scene = Scene.of(arm)
    scene.add_file("cell.scene")
    things: list[Any] = [arm, arm.with_locked({f"j0{NAME}": 0.5}), scene, arm.structure, arm.ik(np.eye(4))]
    things += [*scene.pairs, *scene.hits(np.zeros(6)), arm.ik(np.eye(4), trace=True).trace]
    for thing in things:
        assert hidden(str(thing)) | hidden(repr(thing)) == set()
        assert str(thing).count("\n") == str(thing).replace(NAME, "").count("\n")


def test_errors_and_warnings_are_one_line(folder: Path) -> None:
    arm = kinseek.load("arm.urdf")
    for ask in (
        lambda: arm.ik(np.eye(4), near={f"j0{NAME}": 0.0}),
        lambda: arm.with_locked({"x": 0.0}),
        lambda: kinseek.load("arm.urdf", tip="x"),
        lambda: kinseek.load("\x1b]0;owned\x07.urdf"),
    ):
        with pytest.raises(KinseekError) as caught:
            ask()
        assert hidden(str(caught.value)) == set()
        assert "\n" not in str(caught.value)
        again = pickle.loads(pickle.dumps(caught.value))
        assert str(again) == str(caught.value)
    wide = Path("wide\x1b.urdf")
    wide.write_text(urdf().replace('upper="2"', 'upper="90"'), encoding="utf-8")
    with warnings.catch_warnings(record=True) as caught_warnings:
        warnings.simplefilter("always")
        kinseek.load(wide)
    assert [hidden(str(each.message)) for each in caught_warnings] == [set()]


_XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'
BROKEN = {
    "spaces.urdf": f'<robot xmlns="a{IN_XML}"/>',
    "include.xacro": _XACRO.format(f'<xacro:include filename="{IN_XML}.xacro"/>'),
    "expression.xacro": _XACRO.format(f'<link name="${{a{IN_XML}}}"/>'),
    "condition.xacro": _XACRO.format(f'<xacro:if value="{IN_XML}"/>'),
    "package.xacro": _XACRO.format(f'<link name="$(find {IN_XML})"/>'),
    "keyword.xml": f'<mujoco><worldbody><body><joint type="{IN_XML}"/></body></worldbody></mujoco>',
    "repeated.xml": "<mujoco><worldbody>" + f'<body name="{IN_XML}"/>' * 2 + "</worldbody></mujoco>",
}
"""Files that another library rejects; its message contains the name as it is in the file."""


@pytest.mark.parametrize("trusted", [True, False], ids=["trusted", "untrusted"])
@pytest.mark.parametrize("name", BROKEN)
def test_tracebacks_show_escapes(name: str, trusted: bool, tmp_path: Path) -> None:
    """Python prints the errors that led to an error that nothing catches, too."""
    if name.endswith(".xml"):
        pytest.importorskip("mujoco")
    (tmp_path / name).write_text(BROKEN[name], encoding="utf-8")
    with pytest.raises(KinseekError) as caught:
        kinseek.load(tmp_path / name, trusted=trusted)
    assert hidden("".join(traceback.format_exception(caught.value))) == set()


def test_tracebacks_of_meshes_show_escapes(folder: Path) -> None:
    pytest.importorskip("trimesh")
    pytest.importorskip("coal")
    Path("body.dae").write_text(f'<COLLADA xmlns="a{IN_XML}"/>', encoding="utf-8")
    scene = Scene.of(kinseek.load("arm.urdf"))
    with pytest.raises(KinseekError) as caught:
        scene.add_mesh("body", "body.dae")
    assert hidden("".join(traceback.format_exception(caught.value))) == set()


def test_notebooks_show_escapes(folder: Path) -> None:
    arm = kinseek.load("arm.urdf")
    for text in (arm._repr_html_(), arm.ik(np.eye(4))._repr_html_(), arm.branches(np.eye(4))._repr_html_()):
        assert hidden(text) == set()
    assert f"<td>j0{SHOWN}</td>" in arm._repr_html_()


def test_data_frames_hold_names_as_they_are(folder: Path) -> None:
    pytest.importorskip("pandas")
    arm = kinseek.load("arm.urdf")
    for table in (arm.ik(np.eye(4)).to_frame(), arm.branches(np.eye(4)).to_frame()):
        assert list(table.columns[:6]) == [f"j{i}{NAME}" for i in range(6)]


@pytest.mark.slow
def test_maps_show_escapes(folder: Path) -> None:
    pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    from kinseek import maps

    arm = kinseek.load("arm.urdf")
    grid = maps.Grid((0, 0.4, 0.2), (0, 0.4, 0.2), (0, 0.4, 0.2), maps.orientations(4))
    made = [maps.reach(arm, grid), maps.reach(arm, grid, store="m.zarr"), maps.open("m.zarr")]
    metadata = json.loads(Path("m.zarr/zarr.json").read_text(encoding="utf-8"))
    metadata["attributes"]["title"] = metadata["attributes"]["note\x1b"] = NAME
    Path("m.zarr/zarr.json").write_text(
        json.dumps(metadata), encoding="utf-8"
    )  # As other versions may write it.
    made += [maps.reach(arm, grid, store="m.zarr"), maps.open("m.zarr")]
    assert [each.attrs["title"] for each in made] == [*[f"What r{SHOWN} reaches"] * 3, SHOWN, SHOWN]
    things = [*made, maps.capability(made[0]), maps.best_base(arm, np.eye(4), np.eye(4))]
    for thing in things:
        text = io.StringIO()
        if hasattr(thing, "info"):
            thing.info(text)
        assert (
            hidden(repr(thing) + str(thing) + thing._repr_html_() + text.getvalue().replace("\t", " "))
            == set()
        )


NO_NAMES = {"COLOURS", "draw_arm", "draw_frame", "draw_line", "plane", "same_scale", "save", "space", "trim"}
"""Of `kinseek.plots`: what gets no name of an arm or joint, or nothing but a text of the caller's own."""


def pictures(arm: kinseek.Arm) -> dict[str, Callable[[], Any]]:
    """Of each function of `kinseek.plots` that draws names: a picture of an arm."""
    from kinseek import maps, plots

    q = np.full(arm.dof, 0.3)
    target = kinseek.Goal.pose(arm.fk(q))

    def searched() -> kinseek.Solution:
        return arm.ik(target, solver=kinseek.DivideAndConquer(breadth=1), trace=True)

    def answers() -> kinseek.Branches:
        found = arm.branches(target)
        assert isinstance(found, kinseek.Branches)
        return found

    def reached() -> Any:
        turns = maps.orientations(4)
        return maps.reach(arm, maps.Grid((0, 0.4, 0.2), (0, 0.4, 0.2), (0, 0.4, 0.2), turns))

    def proved() -> Any:
        rings = maps.Rings((0.2, 0.6, 0.2), (0.0, 0.4, 0.2), maps.orientations(4))
        return maps.reach(arm, rings, prove=True, depth=0, budget=50)

    return {
        "arm": lambda: plots.arm(arm, q, goal=target),
        "bases": lambda: plots.bases(maps.best_base(arm, arm.fk(q), [np.eye(4), arm.fk(q)])),
        "boxes": lambda: plots.boxes(arm.prove(target), most=50),
        "branches": lambda: plots.branches(answers()),
        "branches on given axes": lambda: plots.branches(answers(), ax=plots.space()[1]),
        "breadths": lambda: plots.breadths([searched()]),
        "circles": lambda: plots.circles(searched()),
        "cloud": lambda: plots.cloud(reached()),
        "joints": lambda: plots.joints(np.linspace(-q, q, 9), arm),
        "landscape": lambda: plots.landscape(arm.ik(target), points=9),
        "map_slice": lambda: plots.map_slice(reached(), z=0.1),
        "passes": lambda: plots.passes(searched(), points=9),
        "progress": lambda: plots.progress([searched()]),
        "samples": lambda: plots.samples(arm, arm.fk(q)),
        "trajectory": lambda: plots.trajectory(
            arm.follow(arm.fk(np.linspace(q, 1.1 * q, 5)), start=q).timed(1.0, 5.0, tool_speed=0.1)
        ),
        "tree": lambda: plots.tree(searched()),
        "volumes": lambda: plots.volumes([proved()]),
        "windows": lambda: plots.windows(searched(), points=9),
        "workspace": lambda: plots.workspace(arm, target, cells=3, budget=50),
    }


PICTURES = (
    *(
        "arm",
        "bases",
        "boxes",
        "branches",
        "branches on given axes",
        "breadths",
        "circles",
        "cloud",
        "joints",
    ),
    *("landscape", "map_slice", "passes", "progress", "samples", "trajectory", "tree"),
    *("volumes", "windows", "workspace"),
)


def test_every_picture_is_drawn_with_hostile_names() -> None:
    pytest.importorskip("matplotlib")
    from kinseek import plots

    assert set(plots.__all__) - NO_NAMES == {name.partition(" ")[0] for name in PICTURES}
    assert set(pictures(kinseek.load("planar2"))) == set(PICTURES)


@pytest.mark.slow
@pytest.mark.parametrize("picture", PICTURES)
def test_pictures_show_escapes_and_no_formula(picture: str, tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    pytest.importorskip("xarray")
    pytest.importorskip("zarr")
    from matplotlib.cbook import is_math_text
    from matplotlib.text import Text

    from kinseek import plots

    path = tmp_path / "arm.urdf"
    path.write_text(urdf(), encoding="utf-8")
    arm = kinseek.load(path)
    assert arm.name == f"r{NAME}"
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message="Glyph")
        figure = pictures(arm)[picture]()
        texts = [text for text in figure.findobj(Text) if text.get_visible()]
        plots.save(
            figure, tmp_path / "picture.png", dpi=30
        )  # Half a formula is an error, if it is drawn as one.
    drawn = [text.get_text() for text in texts]
    assert hidden("".join(drawn)) == set()
    assert not any(is_math_text(text) for text in drawn if "frac" in text)


def test_web_pages_get_names_as_data(folder: Path) -> None:
    from kinseek.export import to_wasm
    from kinseek.export.javascript import SCRIPT

    arm = kinseek.load("arm.urdf")
    to_wasm([arm], "page", module=b"")
    written = {path.name: path.read_bytes() for path in Path("page").iterdir()}
    assert written["kinseek.js"] == SCRIPT.read_bytes()
    assert hidden(written["arms.json"].decode("ascii")) == set()
    (told,) = json.loads(written["arms.json"])["arms"]
    assert (told["name"], told["joint_names"]) == (arm.name, list(arm.joint_names))
    assert set(written) == {"kinseek.js", "arms.json", "kinseek.wasm"}


def test_the_viewer_shows_escapes(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("viser")
    from kinseek import viewer
    from kinseek.viewer import words

    arm = kinseek.load("arm.urdf")
    assert hidden(words.joints_html(arm, np.zeros(6))) == set()
    assert f"j0{SHOWN}" in words.joints_html(arm, np.zeros(6))
    assert hidden(words.refused_html(NAME) + words.note_html(NAME)) == set()
    with viewer.show(arm, port=0, open_browser=False, block=False) as shown:
        sent = shown._server._websock_server.get_message_buffer().message_from_id.values()
        labels = [
            getattr(each, "label", "") for each in sent if type(each).__name__ == "SetGuiPanelLabelMessage"
        ]
        assert labels == [f"kinseek: r{SHOWN}"]
    assert hidden(capsys.readouterr().out) == set()
