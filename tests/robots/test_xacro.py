"""xacro files: what xacro makes of them, and limits of its work."""

from __future__ import annotations

import os
import sys
import threading
from pathlib import Path

import pytest

from kinseek.errors import InvalidRobot
from kinseek.robots import files, read, read_urdf, xacro_limits
from kinseek.robots.packages import is_planted, mesh_path
from kinseek.robots.xacro import expand_xacro
from robot_files import TURNING, XACRO, joint, link, soon, write

ENDS = link("a") + link("b")
UP = joint(inside='<limit lower="-1" upper="${up}"/>')
"""A joint whose upper limit is a property."""


@pytest.mark.parametrize("trusted", [True, False])
def test_xacro_names_elements(trusted: bool, tmp_path: Path) -> None:
    """``xacro:element`` raised a TypeError of kinseek's own."""
    body = (
        '<xacro:property name="noun" value="link"/><xacro:element xacro:name="${noun}" name="a"/>'
        '<link><xacro:attribute name="name" value="b"/></link>'
    )
    path = write(tmp_path, "r.xacro", XACRO.format(body + joint()))
    assert read_urdf(path, trusted=trusted).tip == "b"


@pytest.mark.parametrize("trusted", [True, False])
def test_xacro_evaluates_a_file_once(trusted: bool, tmp_path: Path) -> None:
    """xacrodoc did so until nothing changed, and so looked for a property of the name that $${…} stands for."""
    names = '<link name="a"/><link name="b$${unknown}"/>'
    text = joint(ends="a b$${unknown}")
    path = write(tmp_path, "r.xacro", XACRO.format(names + text))
    assert read_urdf(path, trusted=trusted).tip == "b${unknown}"


def test_xacro_finds_includes_beside_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, "part.xacro", XACRO.format('<xacro:property name="up" value="2"/>'))
    body = '<xacro:include filename="part.xacro"/>' + ENDS + UP
    path = write(tmp_path, "r.urdf.xacro", XACRO.format(body))
    monkeypatch.chdir(tmp_path.parent)
    before = os.listdir(tmp_path)
    assert read_urdf(path).upper[0] == 2.0
    assert read_urdf(os.path.relpath(path)).upper[0] == 2.0
    assert os.listdir(tmp_path) == before
    assert capfd.readouterr() == ("", "")


def test_same_package_name_in_two_places_stays_apart(tmp_path: Path) -> None:
    for upper in ("2", "3"):
        package = tmp_path / upper / "pack"
        package.mkdir(parents=True)
        write(package, "package.xml", "<package><name>pack</name></package>")
        write(package, "part.xacro", XACRO.format(f'<xacro:property name="up" value="{upper}"/>'))
        body = '<xacro:include filename="$(find pack)/part.xacro"/>' + ENDS + UP
        assert read_urdf(write(package, "r.xacro", XACRO.format(body))).upper[0] == float(upper)


def test_xacro_prints_nothing_and_other_threads_print_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path, "part.xacro", '<robot name="r"/>')
    head = '<xacro:property name="pi" value="3"/><xacro:include filename="part.xacro"/>'
    path = write(tmp_path, "r.xacro", XACRO.format(head + ENDS + TURNING))
    read_bytes = files.file_bytes

    def file_bytes(file: Path, *most: int) -> bytes:
        if file.name == "part.xacro":  # xacro is at work now.
            other = threading.Thread(target=lambda: print("said by another thread", file=sys.stdout))
            other.start()
            other.join()
        return read_bytes(file, *most)

    monkeypatch.setattr(xacro_limits, "file_bytes", file_bytes)
    assert read_urdf(path).dof == 1
    assert capsys.readouterr() == ("said by another thread\n", "")


@pytest.mark.parametrize(
    ("body", "message"),
    [
        ('<xacro:include filename="$(find no_such_package)/x.xacro"/>', "no_such_package"),
        ("<xacro:nothing/>", "nothing"),
        ('<link name="${1 + oops}"/>', "oops"),
        ("<link>", "mismatched tag"),
    ],
)
def test_xacros_own_message_is_shown(
    body: str, message: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InvalidRobot, match=f"xacro failed: .*{message}"):
        read_urdf(write(tmp_path, "r.xacro", XACRO.format(body)))
    assert capfd.readouterr() == ("", "")


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
    body = '<xacro:include filename="$(find pack)/part.xacro"/>' + ENDS + UP
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
    # In a sticky one they cannot change the user's own files, and could only plant a package above these.
    shared.chmod(0o1775)
    assert mesh_path(mesh, path, {}) == real / "a.stl"
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    with pytest.raises(InvalidRobot, match="package 'pack' is not found"):
        read(path)
    shared.chmod(0o1777)
    os.chown(path, 65534, 65534)
    assert (read(path).upper[0], mesh_path(mesh, path, {})) == (1.0, shared / "pack" / "a.stl")


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="files have no owners here")
def test_a_package_that_comes_and_goes_is_not_used(tmp_path: Path) -> None:
    """Another user can take a manifest away while its owner is looked at, and put it back before it is read."""
    path = tmp_path / "own" / "r.xacro"
    tmp_path.chmod(0o1777)
    assert is_planted(tmp_path / "package.xml", path)
    write(tmp_path, "package.xml", "<package/>")
    assert not is_planted(tmp_path / "package.xml", path)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_the_manifest_of_a_package_is_no_pipe_either(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "package.xml")
    include = '<xacro:include filename="$(find p)/part.xacro"/>'
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(write(tmp_path, "r.xacro", XACRO.format(include)))


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


def test_entities_of_a_document_type_are_read(tmp_path: Path) -> None:
    links = '<link name="&one;"/><link name="b"/>'
    text = '<!DOCTYPE robot [<!ENTITY one "a">]>' + XACRO.format(links + TURNING)
    assert read(write(tmp_path, "r.xacro", text)).joint_names == ("j",)


def test_elements_that_are_deep_in_others_are_refused(tmp_path: Path) -> None:
    """For each namespace, some versions of Python go through all elements around it: 700 kB took 14 s."""
    inner = "".join(f'<x{i} xmlns:n{i}="u">' for i in range(20_000))
    text = XACRO.format(inner + "".join(f"</x{i}>" for i in reversed(range(20_000))))
    with soon(2.0), pytest.raises(InvalidRobot, match="257 elements within each other, expected at most 256"):
        read(write(tmp_path, "r.xacro", text))
    links = '<link name="a"/><link name="b"/>'
    text = XACRO.format("<x>" * 255 + "</x>" * 255 + links + TURNING)
    assert read(write(tmp_path, "r.xacro", text)).joint_names == ("j",)


def test_a_document_type_of_many_brackets_is_refused(tmp_path: Path) -> None:
    brackets = "<!DOCTYPE robot [<!ELEMENT a " + "(" * 300_000 + "a" + ")" * 300_000 + ">]>"
    with soon(2.0), pytest.raises(InvalidRobot, match="bytes in the document type, expected at most 10,000"):
        read(write(tmp_path, "r.xacro", brackets + XACRO.format('<link name="l"/>')))


def test_a_pattern_in_the_name_of_a_file_is_allowed(tmp_path: Path) -> None:
    for i in range(2):
        write(tmp_path, f"part{i}.xacro", XACRO.format(f'<link name="l{i}"/>'))
    include = '<xacro:include filename="part[01].xacro"/>'
    path = write(tmp_path, "r.xacro", XACRO.format(include + joint(ends="l0 l1")))
    assert read(path).joint_names == ("j",)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")
def test_xacro_reads_what_was_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file was opened again after it had been checked."""
    path = write(tmp_path, "r.xacro", XACRO.format('<link name="a"/>'))
    checked = files.file_bytes

    def replaced(name: Path, *most: int) -> bytes:
        text = checked(name, *most)
        if most:  # Not at the first look at the file.
            path.unlink()
            os.mkfifo(path)
        return text

    monkeypatch.setattr(xacro_limits, "file_bytes", replaced)
    assert b'<link name="a"/>' in expand_xacro(path)
