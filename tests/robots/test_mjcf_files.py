"""MJCF files: what MuJoCo would copy, include or read without checks is limited or refused."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from kinseek.errors import InvalidRobot
from kinseek.robots import read
from kinseek.robots.files import MOST_BYTES, MOST_LINKS
from kinseek.robots.mjcf_xml import reduced
from robot_files import MODEL, soon, write

mujoco = pytest.importorskip("mujoco")


def test_included_files_count_together(tmp_path: Path) -> None:
    part = "<!--" + "x" * (MOST_BYTES // 4) + "-->"
    includes = ""
    for i in range(4):
        write(tmp_path, f"{i}.xml", f"<x>{part}</x>")
        includes += f"<include file='{i}.xml'/>"
    with pytest.raises(InvalidRobot, match="expected at most"):
        read(write(tmp_path, "m.xml", MODEL.format(includes, "")))


def test_bodies_that_multiply_are_refused(tmp_path: Path) -> None:
    inner = "<body><joint/></body>"
    for _ in range(4):
        inner = f"<replicate count='50'>{inner}</replicate>"
    with soon(), pytest.raises(InvalidRobot, match=f"18,877,552 bodies.*expected at most {MOST_LINKS:,}"):
        read(write(tmp_path, "m.xml", MODEL.format("", inner)))


def test_copies_and_classes_count_also_if_they_are_empty(tmp_path: Path) -> None:
    inner = "<geom size='.1'/>"
    for _ in range(2):
        inner = f"<replicate count='200'>{inner}</replicate>"
    with soon(), pytest.raises(InvalidRobot, match=r"40,202 bodies.*copies counted"):
        read(write(tmp_path, "m.xml", MODEL.format("", inner)))
    classes = "".join(f"<default class='c{i}'/>" for i in range(MOST_LINKS))
    with soon(), pytest.raises(InvalidRobot, match=r"10,003 bodies.*copies counted"):
        read(write(tmp_path, "d.xml", MODEL.format(f"<default>{classes}</default>", "")))
    write(tmp_path, "a.xml", MODEL.format(f"<default>{classes}</default>", ""))
    with soon(), pytest.raises(InvalidRobot, match=r"10,006 bodies.*copies counted"):
        read(write(tmp_path, "m.xml", MODEL.format("<asset><model name='m' file='a.xml'/></asset>", "")))
    twice = (
        "<mujoco><asset><model name='m' file='{}.xml'/></asset>"
        "<worldbody><attach model='m' prefix='l'/><attach model='m' prefix='r'/></worldbody></mujoco>"
    )
    for i in range(13):
        write(tmp_path, f"{i}.xml", twice.format(i + 1))
    write(tmp_path, "13.xml", "<mujoco><worldbody/></mujoco>")
    with soon(), pytest.raises(InvalidRobot, match=r"copies counted, expected at most"):
        read(tmp_path / "0.xml")


@pytest.mark.parametrize(
    ("extra", "body", "message"),
    [
        ("", "<replicate count='500' sep='{0}'><body name='x'/></replicate>", "10,000 letters in 'sep'"),
        ("<default><default class='{0}'/></default>", "", "10,000 letters in 'class'"),
        ("", "<replicate count='4000' sep='{1}'><body name='x'/></replicate>", "letters in names"),
        ("", "<replicate sep='{1}'>" * 200 + "<body name='x'/>" + "</replicate>" * 200, "letters in names"),
        (
            "<asset><model name='m' file='a.xml'/></asset>",
            "<attach model='m' body='b' prefix='{1}{1}'/>" * 5,
            "letters in names",
        ),
    ],
)
def test_long_names_that_multiply_are_refused(extra: str, body: str, message: str, tmp_path: Path) -> None:
    """MuJoCo takes gigabytes for the copies, and compares each name with all others."""
    letters = "a" * 10_000, "a" * 150
    write(tmp_path, "a.xml", MODEL.format("", "<body/>" * 1000))
    text = MODEL.format(extra.format(*letters), body.format(*letters))
    with soon(), pytest.raises(InvalidRobot, match=rf"{message}.*, expected at most"):
        read(write(tmp_path, "m.xml", text))


def test_numbers_of_the_user_are_not_copied(tmp_path: Path) -> None:
    numbers = "1 " * 100_000
    text = MODEL.format(f"<default><joint user='{numbers}'/></default>", f"<site user='{numbers}'/>")
    assert "user" not in reduced(path := write(tmp_path, "m.xml", text)).text
    assert read(path).joint_names == ("j",)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
@pytest.mark.parametrize(
    ("extra", "body", "refused"),
    [
        ("<x:include file='pipe.xml'/>", "", "it is a pipe, expected a regular file"),
        ("<x:asset><mesh name='m' file='pipe.stl'/></x:asset>", "<x:geom type='mesh' mesh='m'/>", None),
        ("<x:asset><texture name='t' type='2d' builtin='flat' width='-1' height='8'/></x:asset>", "", None),
        ("", "<x:replicate count='20000'><x:body/></x:replicate>", "40,002 bodies"),
    ],
)
def test_a_namespace_hides_nothing(extra: str, body: str, refused: str | None, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.xml")
    os.mkfifo(tmp_path / "pipe.stl")
    text = MODEL.format(extra, body).replace("<mujoco>", "<mujoco xmlns:x='u'>")
    path = write(tmp_path, "m.xml", text)
    if refused is None:
        assert read(path).tip == "b"
    else:
        with pytest.raises(InvalidRobot, match=refused):
            read(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
@pytest.mark.parametrize("attached", [False, True])
@pytest.mark.parametrize("word", ["Include", "INCLUDE"])
def test_an_include_in_capitals_is_not_opened_by_mujoco(
    word: str, attached: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo took it for an include, and waited for a pipe in the working folder."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe.xml")
    path = write(tmp_path, "m.xml", MODEL.format(f"<{word} file='pipe.xml'/>", ""))
    if attached:
        path = write(tmp_path, "n.xml", MODEL.format("<asset><model name='m' file='m.xml'/></asset>", ""))
    with pytest.raises(InvalidRobot, match=f"m.xml: <{word}> in line 1, expected <include> in small letters"):
        read(path)


def test_models_that_attach_each_other_are_refused(tmp_path: Path) -> None:
    asset = "<asset><model name='m' file='{}'/></asset>"
    write(tmp_path, "a.xml", MODEL.format(asset.format("b.xml"), ""))
    write(tmp_path, "b.xml", MODEL.format(asset.format("a.xml"), ""))
    with pytest.raises(InvalidRobot, match="attaches itself"):
        read(tmp_path / "a.xml")


def test_an_attached_model_is_read(tmp_path: Path) -> None:
    write(
        tmp_path,
        "hand.xml",
        "<mujoco><worldbody><body name='h'><joint name='k'/></body></worldbody></mujoco>",
    )
    asset = "<asset><model name='m' file='hand.xml'/></asset>"
    attach = (
        "<body name='wrist' pos='0 0 1'><joint name='w'/><attach model='m' body='h' prefix='left_'/></body>"
    )
    chain = read(write(tmp_path, "m.xml", MODEL.format(asset, attach)))
    assert (chain.tip, chain.joint_names) == ("left_h", ("j", "w", "left_k"))


def test_files_of_an_attached_model_are_found_beside_it(tmp_path: Path) -> None:
    """With a file of the same name beside the main one, another robot was read."""
    (tmp_path / "e").mkdir()
    part = "<x><worldbody><body name='{}'><joint name='k'/></body></worldbody></x>"
    write(tmp_path, "b.xml", part.format("main"))
    write(tmp_path, "e/b.xml", part.format("beside"))
    write(tmp_path, "e/m.xml", "<mujoco model='own'><include file='b.xml'/></mujoco>")
    asset = "<asset><model{} file='e/m.xml'/></asset>"
    attach = "<attach model='{}' body='beside' prefix='p_'/>"
    for name, called in ((" name='m'", "m"), ("", "own")):
        path = write(tmp_path, "m.xml", MODEL.format(asset.format(name), attach.format(called)))
        assert read(path).tip == mujoco.MjSpec.from_file(str(path)).bodies[-1].name == "p_beside"
    with pytest.raises(InvalidRobot, match="could not find model"):  # It is not called by its file.
        read(write(tmp_path, "n.xml", MODEL.format(asset.format(""), attach.format("m"))))
    (tmp_path / "e/b.xml").unlink()
    with pytest.raises(InvalidRobot, match="no file"):
        read(path)


@pytest.mark.skipif(not hasattr(os, "symlink"), reason="no links")
def test_a_link_to_itself_is_refused(tmp_path: Path) -> None:
    (tmp_path / "loop.xml").symlink_to(tmp_path / "loop.xml")
    for path in (
        tmp_path / "loop.xml",
        write(tmp_path, "m.xml", "<mujoco><include file='loop.xml'/></mujoco>"),
    ):
        with pytest.raises(InvalidRobot, match="cannot read"):
            read(path)


def test_includes_are_found_as_mujoco_finds_them(tmp_path: Path) -> None:
    (tmp_path / "e").mkdir()
    body = "<x><worldbody><body name='{}'><joint name='k'/></body></worldbody></x>"
    write(tmp_path, "e/a.xml", "<x><include file='b.xml'/></x>")
    write(tmp_path, "e/b.xml", body.format("nested"))
    path = write(tmp_path, "m.xml", "<mujoco><include file='e/a.xml'/></mujoco>")
    for name in ("nested", "main"):
        if name == "main":
            write(tmp_path, "b.xml", body.format(name))
        own = mujoco.MjSpec.from_file(str(path)).bodies[-1].name
        assert read(path).tip == own == name
    with pytest.raises(InvalidRobot, match=r"'e/a.xml' is included twice"):
        read(write(tmp_path, "n.xml", "<mujoco><include file='e/a.xml'/><include file='e/a.xml'/></mujoco>"))


def test_a_file_whose_root_is_an_include_is_only_its_children(tmp_path: Path) -> None:
    write(
        tmp_path,
        "a.xml",
        "<include file='no.xml'><worldbody><body name='in'><joint/></body></worldbody></include>",
    )
    path = write(tmp_path, "m.xml", "<mujoco><include file='a.xml'/></mujoco>")
    assert read(path).tip == "in"
    with pytest.raises(InvalidRobot, match="the root of a model is 'include'"):
        read(tmp_path / "a.xml")


def test_files_that_include_one_another_a_thousand_times_are_refused(tmp_path: Path) -> None:
    for i in range(1200):
        write(tmp_path, f"{i}.xml", f"<x><include file='{i + 1}.xml'/></x>")
    write(tmp_path, "1200.xml", MODEL.format("", ""))
    with soon(), pytest.raises(InvalidRobot, match="nested too deeply"):
        read(write(tmp_path, "m.xml", "<mujoco><include file='0.xml'/></mujoco>"))


@pytest.mark.parametrize("place", ["model", "body", "tip", "joint", "site"])
def test_names_that_are_no_utf_8_are_refused(place: str, tmp_path: Path) -> None:
    names = {
        each: (b"\xff" if each == place else each.encode())
        for each in ("model", "body", "tip", "joint", "site")
    }
    text = (
        b"<mujoco model='%(model)s'><worldbody><body name='%(body)s'><joint name='%(joint)s'/><site name='%(site)s'/>\n"
        b"<body name='%(tip)s'/></body></worldbody></mujoco>"
    )
    fields = {key.encode(): value for key, value in names.items()}
    with pytest.raises(InvalidRobot, match=r"broken XML: .*encoding.*line [12]"):
        read(write(tmp_path, "m.xml", text % fields))


def test_another_encoding_that_says_so_is_read(tmp_path: Path) -> None:
    head = '<?xml version="1.0" encoding="iso-8859-1"?>'
    text = MODEL.format("", "<body name='Händchen'/>")
    assert read(write(tmp_path, "m.xml", (head + text).encode("iso-8859-1"))).tip == "Händchen"


@pytest.mark.parametrize("word", ["nan", "nan(1)", "-NaN(x_1)", "1e400"])
def test_numbers_that_are_none_are_named(word: str, tmp_path: Path) -> None:
    with pytest.raises(
        InvalidRobot, match=re.escape(f"<body> in line 1: pos='0 {word} 0': '{word}' is not finite")
    ):
        read(write(tmp_path, "m.xml", MODEL.format("", f"<body pos='0 {word} 0'/>")))


def test_numbers_that_kinematics_does_not_look_at_may_be_infinite(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    body = "<body name='nan'><joint name='k' damping='{}'/></body>"
    assert read(write(tmp_path, "m.xml", MODEL.format("", body.format("inf")))).tip == "nan"
    with pytest.raises(InvalidRobot, match="damping='nan': 'nan' is not finite"):
        read(write(tmp_path, "n.xml", MODEL.format("", body.format("nan"))))
    assert capfd.readouterr() == ("", "")  # MuJoCo warns of it there.


def test_a_name_like_that_of_a_nameless_body_is_its_own(tmp_path: Path) -> None:
    text = "<mujoco><worldbody><body><joint/><body name='body 1'><joint name='joint 0'/></body></body></worldbody></mujoco>"
    chain = read(write(tmp_path, "m.xml", text))
    assert (chain.tip, chain.joint_names) == ("body 1", ("joint 0'", "joint 0"))


def test_mujoco_names_the_line_of_the_file(tmp_path: Path) -> None:
    text = "<mujoco>\n<!-- a\nremark -->\n<option/>\n<worldbody>\n<body>\n<joint typ='hinge'/>\n</body></worldbody></mujoco>"
    with pytest.raises(InvalidRobot, match=r"(?s)typ.*line 7"):
        read(write(tmp_path, "m.xml", text))


@pytest.mark.slow
def test_models_that_attach_many_models_are_refused_at_once(tmp_path: Path) -> None:
    """Twelve files of a hundred letters, read 3^11 times, took 51 s."""
    (tmp_path / "a0.xml").write_text("<mujoco/>", encoding="utf-8")
    for i in range(1, 12):
        models = "".join(f'<model name="m{k}" file="a{i - 1}.xml"/>' for k in range(3))
        (tmp_path / f"a{i}.xml").write_text(f"<mujoco><asset>{models}</asset></mujoco>", encoding="utf-8")
    with pytest.raises(InvalidRobot, match="models, copies counted"):
        reduced(tmp_path / "a11.xml")


@pytest.mark.parametrize(
    ("declared", "extra"),
    [
        ("<!ENTITY e \"<compiler eulerseq='zyx'/>\">", "&e;"),
        ("<!ATTLIST model name CDATA 'other'>", "<asset><model file='a.xml'/></asset>"),
    ],
)
def test_mjcf_with_declarations_is_refused(declared: str, extra: str, tmp_path: Path) -> None:
    """MuJoCo ignores them: it turned bodies otherwise, and copied models that were counted under another name."""
    write(tmp_path, "a.xml", "<mujoco model='a'><worldbody><body name='r'/></worldbody></mujoco>")
    path = write(tmp_path, "m.xml", f"<!DOCTYPE mujoco [{declared}]>" + MODEL.format(extra, ""))
    with pytest.raises(InvalidRobot, match=r"m.xml: it has a document type \(<!DOCTYPE …>\), which MuJoCo"):
        read(path)


@pytest.mark.parametrize(
    ("extra", "body", "why"),
    [
        (
            "<asset><model name='m' file='large.xml'/><model name='m' file='small.xml'/></asset>",
            "".join(f"<attach model='m' body='r' prefix='p{i}'/>" for i in range(100)),
            "two models are called 'm'",
        ),
        (
            "",
            "<body name='x0'/>"
            + "".join(
                f"<body name='x{k}'><attach body='x{k - 1}' prefix='a{k}'/><attach body='x{k - 1}' prefix='b{k}'/></body>"
                for k in range(1, 14)
            ),
            "<attach> in line 1 has no model",
        ),
    ],
)
def test_copies_that_are_not_counted_are_refused(extra: str, body: str, why: str, tmp_path: Path) -> None:
    """MuJoCo attached the first of two models, and the last was counted; or a file doubled its own bodies."""
    for name, count in (("large", 200), ("small", 0)):
        bodies = f"<body name='r'>{'<body/>' * count}</body>"
        write(tmp_path, f"{name}.xml", f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")
    with soon(), pytest.raises(InvalidRobot, match=why):
        read(write(tmp_path, "m.xml", MODEL.format(extra, body)))


@pytest.mark.slow
def test_reading_a_model_runs_no_python_file_of_the_working_folder(tmp_path: Path) -> None:
    write(tmp_path, "m.xml", MODEL.format("", ""))
    for name in ("ctypes", "textwrap", "sitecustomize"):
        (tmp_path / f"{name}.py").write_text("open('ran', 'w').close()\n")
    code = (
        "import os, kinseek.robots; before = dict(os.environ); "
        "kinseek.robots.read('m.xml'); assert dict(os.environ) == before"
    )
    done = subprocess.run(
        [sys.executable, "-P", "-c", code], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "ran").exists()
