"""Files of robots that would hang a reader or fill the memory are refused, and the message says the limit."""

from __future__ import annotations

import contextlib
import errno
import os
import sys
from pathlib import Path
from unittest.mock import MagicMock

import numpy as np
import pytest

from kinseek.errors import InvalidRobot
from kinseek.robots import files, read, read_dh
from kinseek.robots.files import (
    MOST_BYTES,
    MOST_JOINTS,
    MOST_LINKS,
    MOST_NAME,
    file_bytes,
    require_here,
    without_links,
)
from kinseek.robots.packages import mesh_path
from robot_files import MODEL, XACRO, joint, robot, soon, write

SUFFIXES = (".urdf", ".xacro", ".xml")


PIPES = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with names here")


def needs(suffix: str) -> None:
    if suffix == ".xml":
        pytest.importorskip("mujoco")


@PIPES
@pytest.mark.parametrize("suffix", SUFFIXES)
@pytest.mark.parametrize("kind", ["pipe", "device", "folder"])
def test_what_is_no_regular_file_is_refused(kind: str, suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    path = tmp_path / f"robot{suffix}"
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path.symlink_to("/dev/zero")
    else:
        path.mkdir()
    with pytest.raises(InvalidRobot, match=f"it is a {kind}, expected a regular file"):
        read(path)


@PIPES
@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_pipe_that_replaces_a_checked_file_is_refused(
    suffix: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its owner can do that at any moment, and the reader waited for the other end."""
    needs(suffix)
    path = write(tmp_path, f"r{suffix}", "<robot/>")
    look = files.instead_of_a_file

    def replaced(checked: Path) -> str:
        found = look(checked)
        path.unlink(missing_ok=True)
        os.mkfifo(path)
        return found

    monkeypatch.setattr(files, "instead_of_a_file", replaced)
    with soon(), pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
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


@PIPES
@pytest.mark.parametrize(
    ("file", "text"),
    [
        ("r.xacro", XACRO.format('<xacro:include filename="pipe"/>')),
        ("m.xml", MODEL.format("<include file='pipe'/>", "")),
        ("n.xml", MODEL.format("<asset><model name='m' file='pipe'/></asset>", "")),
    ],
)
def test_what_a_file_includes_is_no_pipe_either(file: str, text: str, tmp_path: Path) -> None:
    needs(Path(file).suffix)
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(InvalidRobot, match="it is a pipe, expected a regular file"):
        read(write(tmp_path, file, text))


def test_a_file_of_the_kernel_without_new_data_is_empty(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Reading of /proc/kmsg returns None, which ended in a TypeError."""
    path = write(tmp_path, "r.urdf", "")
    with path.open("rb") as opened:
        file = MagicMock(wraps=opened, read=lambda size: None)
        monkeypatch.setattr("builtins.open", lambda *args, **options: contextlib.nullcontext(file))
        assert file_bytes(path) == b""
        monkeypatch.undo()


def test_a_link_that_changes_meanwhile_leads_nowhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It became a file between two steps of `resolve`, which then raises an OSError."""

    def changed(path: Path) -> Path:
        raise OSError(errno.EINVAL, "Invalid argument")

    monkeypatch.setattr(Path, "resolve", changed)
    assert without_links(tmp_path / "a") == tmp_path / "a"


def test_a_missing_file_is_not_meant_by_its_own_name(tmp_path: Path) -> None:
    (tmp_path / "a.urdf").symlink_to("nowhere")
    write(tmp_path, "b.urdf", "")
    with pytest.raises(InvalidRobot, match=r"did you mean 'b.urdf'\? In its folder: b.urdf$"):
        file_bytes(tmp_path / "a.urdf")


def test_a_message_lists_few_of_the_files_that_may_be_meant(tmp_path: Path) -> None:
    """A file of 21 kB that names 300 missing meshes beside a thousand others had notes of 75 MB."""
    for i in range(30):
        write(tmp_path, f"b{i}.urdf", "")
    with pytest.raises(InvalidRobot, match=r"In its folder: (b\d+.urdf, ){19}b\d+.urdf and 10 more$"):
        file_bytes(tmp_path / "a.urdf")


def tree(count: int, kind: str, row: bool, comb: bool = False) -> str:
    """Links in a row, or all below the first; in a comb each of the row has a tooth."""
    joints = [joint(f"j{i}", f"l{i if row else 0} l{i + 1}", kind, "") for i in range(count)]
    teeth = range(count if comb else 0)
    joints += [joint(f"k{i}", f"l{i} t{i}", "fixed", "") for i in teeth]
    names = [*(f"l{i}" for i in range(count + 1)), *(f"t{i}" for i in teeth)]
    return robot(*joints, links=" ".join(names))


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
    text = tree(MOST_LINKS // 2 - 1, "continuous", row=True, comb=True)
    with soon(), pytest.raises(InvalidRobot, match=r"branches below base .* and .* more"):
        read(write(tmp_path, "r.urdf", text))


@pytest.mark.parametrize("place", ['robot name="', 'link name="', 'joint name="'])
def test_long_names_are_refused(place: str, tmp_path: Path) -> None:
    text = tree(1, "continuous", row=True)
    read(write(tmp_path, "r.urdf", text.replace('joint name="j0', f'joint name="{"x" * MOST_NAME}')))
    with soon(), pytest.raises(InvalidRobot, match="letters in a name, expected at most 1,000"):
        read(write(tmp_path, "s.urdf", text.replace(place, place + "x" * MOST_NAME)))


def test_a_long_table_is_refused() -> None:
    count = MOST_JOINTS + 1
    with pytest.raises(InvalidRobot, match="1,001 moving joints"):
        read_dh(np.zeros((count, 4)), [-1] * count, [1] * count)


@pytest.mark.parametrize("suffix", [".urdf", ".xml"])
def test_entities_that_grow_are_refused(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    laughs = "<!ENTITY a0 'ha'>" + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12))
    path = write(tmp_path, f"r{suffix}", f"<!DOCTYPE robot [{laughs}]><robot name='&a11;'/>")
    with soon(), pytest.raises(InvalidRobot, match=r"entity|entities"):
        read(path)


@pytest.mark.skipif(sys.platform == "win32", reason="other names are valid")
def test_a_name_that_is_none_is_refused() -> None:
    with pytest.raises(InvalidRobot, match="is not a valid file name"):
        read("a\0b.urdf")


ELSEWHERE = (
    "//server/share/a.xml",
    "//server",
    "//?/C:/a.xml",
    r"/\server/share/a.xml",
    r"\\server\share\a.xml",
)
INCLUDES = (
    ("r.xml", MODEL.format("<include file='{}'/>", "")),
    ("r.xml", MODEL.format("<asset><model name='m' file='{}'/></asset>", "")),
    ("r.xacro", XACRO.format("<xacro:include filename='{}'/>")),
    ("r.xacro", XACRO.format("<xacro:include filename='{}*'/>")),
    (
        "r.xacro",
        XACRO.format("<xacro:property name='p' value='${{xacro.load_yaml(&quot;{}&quot;)}}'/>${{p}}"),
    ),
)


@pytest.mark.parametrize("trusted", [True, False])
@pytest.mark.parametrize(("file", "text"), INCLUDES)
def test_windows_connects_to_no_other_machine(
    file: str, text: str, trusted: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It would report the user's name, and a digest of the password, to any server that a file names."""
    needs(Path(file).suffix)
    monkeypatch.setattr(files, "WINDOWS", True)
    # xacro puts its folder before a name that is relative on this system, and a ? is a pattern.
    for name in ELSEWHERE[: 2 if file == "r.xacro" else None]:
        with pytest.raises(InvalidRobot, match="is a file of another machine"):
            read(write(tmp_path, file, text.format(name)), trusted=trusted)


def test_windows_looks_for_no_mesh_on_another_machine(monkeypatch: pytest.MonkeyPatch) -> None:
    here = Path("/robots/r.urdf")
    for name in ELSEWHERE:
        assert mesh_path(name, here, {})  # Two slashes are one on other systems.
    monkeypatch.setattr(files, "WINDOWS", True)
    for name in ELSEWHERE:
        for address in (
            name,
            f"file://{name}",
            name.replace("\\", "%5c"),
            f"file://{name.replace('/', '%2F')}",
        ):
            with pytest.raises(InvalidRobot, match="is a file of another machine"):
                mesh_path(address, here, {})
    assert mesh_path("file:///robots/a.stl", here, {}) == Path("/robots/a.stl")


def test_windows_reads_the_share_of_the_robot_and_of_its_packages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "WINDOWS", True)
    here = Path("/robots/r.urdf")
    require_here("//Server/share/p/a.stl", here, ["//server/Share/p"])
    for name in ("//server/other/a.stl", "//server", "//?/UNC/server/share/a.stl"):
        with pytest.raises(InvalidRobot, match="is a file of another machine"):
            require_here(name, here, ["//server/share/p"])
