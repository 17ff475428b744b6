"""Files that would hang a reader or fill the memory are refused, and the message says the limit."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from kinseek.errors import InvalidRobot
from kinseek.robots import read, read_dh, xacro_limits
from kinseek.robots.files import MOST_BYTES, MOST_JOINTS, MOST_LINKS
from kinseek.robots.mjcf_xml import reduced
from kinseek.robots.packages import mesh_path

SUFFIXES = (".urdf", ".xacro", ".xml")
XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'
MODEL = "<mujoco>{}<worldbody><body name='b'><joint name='j'/>{}</body></worldbody></mujoco>"


@contextmanager
def soon(seconds: float = 10.0) -> Iterator[None]:
    begin = time.process_time()
    yield
    assert time.process_time() - begin < seconds


def write(folder: Path, name: str, text: str | bytes) -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def needs(suffix: str) -> None:
    if suffix == ".xml":
        pytest.importorskip("mujoco")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_pipe_is_refused(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    path = tmp_path / f"pipe{suffix}"
    os.mkfifo(path)
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(path)


@pytest.mark.skipif(
    not hasattr(os, "getuid") or os.getuid() != 0, reason="only root makes files of other users"
)
@pytest.mark.parametrize("manifest", ["package.xml", "manifest.xml"])
def test_a_package_that_another_user_planted_is_not_used(
    manifest: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder like /tmp anybody could give a file's package another content, and xacro runs Python."""
    shared, real = tmp_path / "shared", tmp_path / "ros" / "pack"
    (shared / "own").mkdir(parents=True)
    real.mkdir(parents=True)
    for folder in (shared, shared / "pack", real):
        folder.mkdir(exist_ok=True)
        write(folder, "part.xacro", XACRO.format('<xacro:property name="up" value="1"/>'))
        write(folder, manifest, "<package><name>pack</name></package>")
        write(folder, "a.stl", "")
    body = (
        '<xacro:include filename="$(find pack)/part.xacro"/><link name="a"/><link name="b"/>'
        '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><limit lower="0" upper="${up}"/></joint>'
    )
    path = write(shared / "own", "r.xacro", XACRO.format(body))
    shared.chmod(0o1777)
    mesh = "package://pack/a.stl"
    assert (read(path).upper[0], mesh_path(mesh, path, {})) == (1.0, shared / "pack" / "a.stl")
    for each in (shared / manifest, shared / "pack"):
        os.chown(each, 65534, 65534)
    with pytest.raises(InvalidRobot, match="package 'pack' is not found"):
        read(path)
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    assert mesh_path(mesh, path, {}) == real / "a.stl"
    monkeypatch.chdir(path.parent)
    assert mesh_path(mesh, Path("the URDF text"), {}) == real / "a.stl"
    # A shared folder that only a group can write to is not such a folder, and neither are the owner's own files.
    shared.chmod(0o775)
    assert (read(path).upper[0], mesh_path(mesh, path, {})) == (1.0, shared / "pack" / "a.stl")
    shared.chmod(0o1777)
    os.chown(path, 65534, 65534)
    assert (read(path).upper[0], mesh_path(mesh, path, {})) == (1.0, shared / "pack" / "a.stl")


@pytest.mark.skipif(not Path("/dev/zero").exists(), reason="no such device here")
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_device_is_refused(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    path = tmp_path / f"zero{suffix}"
    path.symlink_to("/dev/zero")
    with pytest.raises(InvalidRobot, match="it is a device, expected a regular file"):
        read(path)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_huge_file_is_refused_unread(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    path = write(tmp_path, f"huge{suffix}", "<robot>")
    os.truncate(path, 5 * 10**9)
    with (
        soon(2.0),
        pytest.raises(InvalidRobot, match=f"5,000,000,000 bytes, expected at most {MOST_BYTES:,}"),
    ):
        read(path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_what_a_file_includes_is_no_pipe_either(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    for suffix in (".xacro", ".xml"):
        os.mkfifo(tmp_path / f"pipe{suffix}")
    include = '<xacro:include filename="pipe.xacro"/>'
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(write(tmp_path, "r.xacro", XACRO.format(include)))
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(write(tmp_path, "m.xml", MODEL.format("<include file='pipe.xml'/>", "")))
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(write(tmp_path, "n.xml", MODEL.format("<asset><model name='m' file='pipe.xml'/></asset>", "")))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_the_manifest_of_a_package_is_no_pipe_either(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "package.xml")
    include = '<xacro:include filename="$(find p)/part.xacro"/>'
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(write(tmp_path, "r.xacro", XACRO.format(include)))


def test_included_files_count_together(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    part = "<!--" + "x" * (MOST_BYTES // 4) + "-->"
    includes = ""
    for i in range(4):
        write(tmp_path, f"{i}.xml", f"<x>{part}</x>")
        includes += f"<include file='{i}.xml'/>"
    with pytest.raises(InvalidRobot, match="expected at most"):
        read(write(tmp_path, "m.xml", MODEL.format(includes, "")))


def tree(count: int, kind: str, row: bool) -> str:
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="{kind}"><parent link="l{i if row else 0}"/><child link="l{i + 1}"/></joint>'
        for i in range(count)
    )
    return f'<robot name="r">{links}{joints}</robot>'


@pytest.mark.slow
def test_twenty_thousand_joints_are_refused(tmp_path: Path) -> None:
    with soon(), pytest.raises(InvalidRobot, match=f"20,001 links, expected at most {MOST_LINKS:,}"):
        read(write(tmp_path, "r.urdf", tree(20_000, "continuous", row=True)))
    with soon(), pytest.raises(InvalidRobot, match=f"9,999 moving joints.*expected at most {MOST_JOINTS:,}"):
        read(write(tmp_path, "s.urdf", tree(MOST_LINKS - 1, "continuous", row=True)))


@pytest.mark.slow
@pytest.mark.parametrize("row", [True, False])
def test_a_file_just_below_the_limit_is_read_soon(row: bool, tmp_path: Path) -> None:
    path = write(tmp_path, "r.urdf", tree(MOST_LINKS - 1, "fixed" if row else "continuous", row))
    with (
        soon(),
        pytest.raises(
            InvalidRobot, match="no movable joint" if row else "branches below base .* and 9959 more"
        ),
    ):
        read(path)


@pytest.mark.slow
def test_a_comb_is_read_soon(tmp_path: Path) -> None:
    half = MOST_LINKS // 2 - 1
    text = tree(half, "continuous", row=True).removesuffix("</robot>")
    text += "".join(
        f'<link name="t{i}"/><joint name="k{i}" type="fixed"><parent link="l{i}"/><child link="t{i}"/></joint>'
        for i in range(half)
    )
    with soon(), pytest.raises(InvalidRobot, match=r"branches below base .* and .* more"):
        read(write(tmp_path, "r.urdf", text + "</robot>"))


def test_a_long_table_is_refused() -> None:
    count = MOST_JOINTS + 1
    with pytest.raises(InvalidRobot, match="1,001 moving joints"):
        read_dh(np.zeros((count, 4)), [-1] * count, [1] * count)


def test_bodies_that_multiply_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    inner = "<body><joint/></body>"
    for _ in range(4):
        inner = f"<replicate count='50'>{inner}</replicate>"
    with soon(), pytest.raises(InvalidRobot, match=f"18,877,552 bodies.*expected at most {MOST_LINKS:,}"):
        read(write(tmp_path, "m.xml", MODEL.format("", inner)))


def test_copies_and_classes_count_also_if_they_are_empty(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
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
    pytest.importorskip("mujoco")
    letters = "a" * 10_000, "a" * 150
    write(tmp_path, "a.xml", MODEL.format("", "<body/>" * 1000))
    text = MODEL.format(extra.format(*letters), body.format(*letters))
    with soon(), pytest.raises(InvalidRobot, match=rf"{message}.*, expected at most"):
        read(write(tmp_path, "m.xml", text))


def test_numbers_of_the_user_are_not_copied(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
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
    pytest.importorskip("mujoco")
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
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    os.mkfifo(tmp_path / "pipe.xml")
    path = write(tmp_path, "m.xml", MODEL.format(f"<{word} file='pipe.xml'/>", ""))
    if attached:
        path = write(tmp_path, "n.xml", MODEL.format("<asset><model name='m' file='m.xml'/></asset>", ""))
    with pytest.raises(InvalidRobot, match=f"m.xml: <{word}> in line 1, expected <include> in small letters"):
        read(path)


def test_models_that_attach_each_other_are_refused(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    asset = "<asset><model name='m' file='{}'/></asset>"
    write(tmp_path, "a.xml", MODEL.format(asset.format("b.xml"), ""))
    write(tmp_path, "b.xml", MODEL.format(asset.format("a.xml"), ""))
    with pytest.raises(InvalidRobot, match="attaches itself"):
        read(tmp_path / "a.xml")


def test_an_attached_model_is_read(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
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


def test_includes_are_found_as_mujoco_finds_them(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
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
    pytest.importorskip("mujoco")
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
    pytest.importorskip("mujoco")
    for i in range(1200):
        write(tmp_path, f"{i}.xml", f"<x><include file='{i + 1}.xml'/></x>")
    write(tmp_path, "1200.xml", MODEL.format("", ""))
    with soon(), pytest.raises(InvalidRobot, match="nested too deeply"):
        read(write(tmp_path, "m.xml", "<mujoco><include file='0.xml'/></mujoco>"))


def test_macros_that_multiply_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert 10_000 < xacro_limits._MOST_STEPS < 10**5
    monkeypatch.setattr(xacro_limits, "_MOST_STEPS", 2000)
    macros = '<xacro:macro name="m0"><link name="l"/></xacro:macro>'
    for i in range(1, 40):
        macros += f'<xacro:macro name="m{i}"><xacro:m{i - 1}/><xacro:m{i - 1}/></xacro:macro>'
    with soon(), pytest.raises(InvalidRobot, match="elements to expand, expected at most"):
        read(write(tmp_path, "r.xacro", XACRO.format(macros + "<xacro:m39/>")))


@pytest.mark.slow
def test_a_large_file_that_includes_itself_is_refused_soon(tmp_path: Path) -> None:
    links = "".join(f'<link name="l{i}"/>' for i in range(3000))
    with soon(), pytest.raises(InvalidRobot, match="33 files, each included by the one before"):
        read(write(tmp_path, "r.xacro", XACRO.format('<xacro:include filename="r.xacro"/>' + links)))


def test_properties_that_grow_are_refused(tmp_path: Path) -> None:
    properties = '<xacro:property name="p0" value="ha"/>'
    for i in range(1, 40):
        properties += f'<xacro:property name="p{i}" value="${{p{i - 1}}}${{p{i - 1}}}"/>'
    with soon(), pytest.raises(InvalidRobot, match="letters in one value, expected at most"):
        read(write(tmp_path, "r.xacro", XACRO.format(properties + '<link name="${p39}"/>')))


COPIED = "<a b=''/>" * 300
"""What takes xacro long although little is written, and what it is then said to be busy with."""
BUSY = {
    "a macro whose body is left out": (
        f'<xacro:macro name="m"><xacro:if value="0">{COPIED}</xacro:if></xacro:macro>' + "<xacro:m/>" * 400,
        "copies of macros",
    ),
    "a macro within a macro within a macro": (
        f'<xacro:macro name="m" params="*z"><xacro:if value="0">{COPIED}</xacro:if></xacro:macro>'
        + ("<xacro:m>" * 40 + "<a/>" + "</xacro:m>" * 40),
        "copies of macros",
    ),
    "a block": (
        f'<xacro:property name="z"><xacro:if value="0">{COPIED}</xacro:if></xacro:property>'
        + '<xacro:insert_block name="z"/>' * 400,
        "copies of blocks",
    ),
    "default values": (
        f'<xacro:macro name="m" params="{" ".join(f"a{i}=1" for i in range(200))}"/>' + "<xacro:m/>" * 100,
        "values",
    ),
    "long names": (
        f'<xacro:property name="x" value="{"x" * 10_000}"/>' + '<link name="${x}"/>' * 200,
        "values",
    ),
    "many dollars": ('<link name="' + "${1}" * 2000 + '"/>', "values"),
    "lists of parameters": (f'<xacro:macro name="m" params="{"a " * 3000}"/>', "parameters of macros"),
    "many beside each other": ("<a/>" * 1600 + '<xacro:if value="0"/>' * 1500, "elements of one parent"),
    "many elements": ("<a/>" * 8000, "elements, attributes and comments"),
    "many comments": ("<!---->" * 8000, "elements, attributes and comments"),
    "many files": ('<xacro:include filename="none.xacro" optional="true"/>' * 100, "files that are opened"),
    "many patterns": ('<xacro:include filename="*.none"/>' * 10, "patterns of includes"),
}


@pytest.mark.parametrize("what", BUSY)
def test_what_takes_xacro_long_is_refused(what: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert 2**23 < xacro_limits._MOST_WORK <= 2**25, "the limit that was tried with real files"
    monkeypatch.setattr(xacro_limits, "_MOST_WORK", 2**19)
    text, busy = BUSY[what]
    with (
        soon(2.0),
        pytest.raises(InvalidRobot, match=f"too much to do, at last with {busy}: .* units of work"),
    ):
        read(write(tmp_path, "r.xacro", XACRO.format(text)))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('<xacro:include filename="*/part.xacro"/>', r"the include .*part\.xacro' has \*"),
        ('<xacro:include filename="[a-z]/../*.xacro"/>', "expected them in the name of the file alone"),
        (
            f'<xacro:macro name="m" params="{" ".join(f"a{i}=1" for i in range(257))}"/><xacro:m/>',
            "257 parameters of one macro, expected at most 256",
        ),
        (f'<xacro:property name="{"1;" * 5001}" value="1"/>', "10,002 letters in the name of a property"),
        (
            '<xacro:arg name="a" default="x"/><xacro:property name="q" value="arg a)$$(arg a)$$(arg a"/>'
            '<link name="$(${q})"/>',
            "in one, expected at most 1",
        ),
    ],
)
@pytest.mark.parametrize("trusted", [True, False])
def test_other_things_that_would_take_xacro_long_are_refused(
    text: str, message: str, trusted: bool, tmp_path: Path
) -> None:
    (tmp_path / "folder").mkdir()
    write(tmp_path / "folder", "part.xacro", "<robot/>")
    with soon(2.0), pytest.raises(InvalidRobot, match=message):
        read(write(tmp_path, "r.xacro", XACRO.format(text)), trusted=trusted)


def test_a_default_that_could_be_divided_in_many_ways_is_read_soon(tmp_path: Path) -> None:
    macro = f"""<xacro:macro name="m" params="a:={"b" * 60}'"/>"""
    with soon(2.0), pytest.raises(InvalidRobot, match="no movable joint"):
        read(write(tmp_path, "r.xacro", XACRO.format(macro + '<link name="l"/>')))


def test_a_document_type_of_many_brackets_is_refused(tmp_path: Path) -> None:
    brackets = "<!DOCTYPE robot [<!ELEMENT a " + "(" * 300_000 + "a" + ")" * 300_000 + ">]>"
    with soon(2.0), pytest.raises(InvalidRobot, match="bytes in the document type, expected at most 10,000"):
        read(write(tmp_path, "r.xacro", brackets + XACRO.format('<link name="l"/>')))


def test_a_pattern_in_the_name_of_a_file_is_allowed(tmp_path: Path) -> None:
    for i in range(2):
        write(tmp_path, f"part{i}.xacro", XACRO.format(f'<link name="l{i}"/>'))
    joint = '<joint name="j" type="continuous"><parent link="l0"/><child link="l1"/></joint>'
    path = write(tmp_path, "r.xacro", XACRO.format('<xacro:include filename="part[01].xacro"/>' + joint))
    assert read(path).joint_names == ("j",)


@pytest.mark.parametrize("suffix", [".urdf", ".xml"])
def test_entities_that_grow_are_refused(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    laughs = "<!ENTITY a0 'ha'>" + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12))
    path = write(tmp_path, f"r{suffix}", f"<!DOCTYPE robot [{laughs}]><robot name='&a11;'/>")
    with soon(), pytest.raises(InvalidRobot, match=r"entity|entities"):
        read(path)


# Names and numbers of MJCF


@pytest.mark.parametrize("place", ["model", "body", "tip", "joint", "site"])
def test_names_that_are_no_utf_8_are_refused(place: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
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
    pytest.importorskip("mujoco")
    head = '<?xml version="1.0" encoding="iso-8859-1"?>'
    text = MODEL.format("", "<body name='Händchen'/>")
    assert read(write(tmp_path, "m.xml", (head + text).encode("iso-8859-1"))).tip == "Händchen"


@pytest.mark.parametrize("word", ["nan", "nan(1)", "-NaN(x_1)", "1e400"])
def test_numbers_that_are_none_are_named(word: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    with pytest.raises(
        InvalidRobot, match=re.escape(f"<body> in line 1: pos='0 {word} 0': '{word}' is not finite")
    ):
        read(write(tmp_path, "m.xml", MODEL.format("", f"<body pos='0 {word} 0'/>")))


def test_numbers_that_kinematics_does_not_look_at_may_be_infinite(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    body = "<body name='nan'><joint name='k' damping='{}'/></body>"
    assert read(write(tmp_path, "m.xml", MODEL.format("", body.format("inf")))).tip == "nan"
    with pytest.raises(InvalidRobot, match="damping='nan': 'nan' is not finite"):
        read(write(tmp_path, "n.xml", MODEL.format("", body.format("nan"))))
    assert capfd.readouterr() == ("", "")  # MuJoCo warns of it there.


def test_a_name_like_that_of_a_nameless_body_is_its_own(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = "<mujoco><worldbody><body><joint/><body name='body 1'><joint name='joint 0'/></body></body></worldbody></mujoco>"
    chain = read(write(tmp_path, "m.xml", text))
    assert (chain.tip, chain.joint_names) == ("body 1", ("joint 0'", "joint 0"))


def test_mujoco_names_the_line_of_the_file(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    text = "<mujoco>\n<!-- a\nremark -->\n<option/>\n<worldbody>\n<body>\n<joint typ='hinge'/>\n</body></worldbody></mujoco>"
    with pytest.raises(InvalidRobot, match=r"(?s)typ.*line 7"):
        read(write(tmp_path, "m.xml", text))


def test_a_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r.urdf").mkdir()
    with pytest.raises(InvalidRobot, match="it is a folder"):
        read(tmp_path / "r.urdf")
    if sys.platform != "win32":
        with pytest.raises(InvalidRobot, match="is not a valid file name"):
            read("a\0b.urdf")


@pytest.mark.slow
def test_models_that_attach_many_models_are_refused_at_once(tmp_path: Path) -> None:
    """Twelve files of a hundred letters, read 3^11 times, took 51 s."""
    (tmp_path / "a0.xml").write_text("<mujoco/>", encoding="utf-8")
    for i in range(1, 12):
        models = "".join(f'<model name="m{k}" file="a{i - 1}.xml"/>' for k in range(3))
        (tmp_path / f"a{i}.xml").write_text(f"<mujoco><asset>{models}</asset></mujoco>", encoding="utf-8")
    with pytest.raises(InvalidRobot, match="models, copies counted"):
        reduced(tmp_path / "a11.xml")
