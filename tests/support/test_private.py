"""Folders and files that another user could change are refused: machine code is read from them."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import kinseek
from kinseek import maps
from kinseek.support import private
from kinseek.support.private import NotPrivate, private_folder, read_private, resolved, user_cache
from kinseek.support.whole_file import output_path

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="needs POSIX permissions")

ANOTHER = 65534


def mode(path: Path) -> int:
    return stat.S_IMODE(path.lstat().st_mode)


@pytest.fixture(name="umask", params=[0o000, 0o002, 0o022, 0o077], ids=oct)
def _umask(request: pytest.FixtureRequest) -> object:
    before = os.umask(request.param)
    yield request.param
    os.umask(before)


@pytest.mark.usefixtures("umask")
@pytest.mark.parametrize(
    ("named", "folder"),
    [("/a/b", "/a/b"), ("~/c", "~/c"), ("here", "~/.cache"), ("", "~/.cache")],
)
def test_a_relative_folder_for_caches_does_not_count(
    monkeypatch: pytest.MonkeyPatch, named: str, folder: str
) -> None:
    monkeypatch.setenv("HOME", "/home")
    monkeypatch.delenv("LOCALAPPDATA", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", named)
    assert user_cache() == folder


def test_folders_are_made_for_their_user_alone_whatever_the_umask(tmp_path: Path) -> None:
    made = private_folder(tmp_path / "home" / ".cache", "kinseek", "code")
    assert made == tmp_path.resolve() / "home" / ".cache" / "kinseek" / "code"
    for folder in (made, *list(made.parents)[:3]):
        assert mode(folder) == 0o700
    assert private_folder(tmp_path / "home" / ".cache", "kinseek", "code") == made


@pytest.mark.parametrize("bits", [0o770, 0o702, 0o777, 0o720], ids=oct)
@pytest.mark.parametrize("name", ["home", "home/.cache", "home/.cache/kinseek", "home/.cache/kinseek/code"])
def test_a_folder_that_others_may_write_to_is_refused_wherever_it_is(
    tmp_path: Path, name: str, bits: int
) -> None:
    private_folder(tmp_path / "home" / ".cache", "kinseek", "code")
    (tmp_path / name).chmod(bits)
    with pytest.raises(NotPrivate, match=rf"others may write to .*/{name} \(mode {bits:o}\)"):
        private_folder(tmp_path / "home" / ".cache", "kinseek", "code")


def test_what_kinseek_makes_is_no_link(tmp_path: Path) -> None:
    planted = private_folder(tmp_path / "elsewhere", "kinseek", "code")
    base = private_folder(tmp_path / "home")
    (base / "kinseek").symlink_to(planted.parent)
    with pytest.raises(NotPrivate, match="home/kinseek is a link"):
        private_folder(base, "kinseek", "code")
    (base / "kinseek").unlink()
    (base / "kinseek").mkdir(mode=0o700)
    (base / "kinseek" / "code").symlink_to(planted)
    with pytest.raises(NotPrivate, match="home/kinseek/code is a link"):
        private_folder(base, "kinseek", "code")


@pytest.mark.parametrize("absolute", [True, False])
def test_a_link_of_the_user_is_followed_once_and_for_all(tmp_path: Path, absolute: bool) -> None:
    real, other = (private_folder(tmp_path / name) for name in ("real", "other"))
    link = tmp_path / "link"
    link.symlink_to(real if absolute else Path("other") / ".." / "real")
    found = private_folder(link, "kinseek")
    link.unlink()
    link.symlink_to(other)
    assert found == tmp_path.resolve() / "real" / "kinseek"
    assert list(other.iterdir()) == []


def test_a_link_in_a_folder_of_others_is_refused(tmp_path: Path) -> None:
    """They may let it lead anywhere, even to a folder that is the user's own."""
    real, shared = private_folder(tmp_path / "real"), private_folder(tmp_path / "shared")
    (shared / "link").symlink_to(real)
    shared.chmod(0o777)
    (tmp_path / "way").symlink_to(shared / "link")
    with pytest.raises(NotPrivate, match=r"others may write to .*/shared"):
        private_folder(tmp_path / "way", "kinseek")


def test_links_in_a_ring_are_refused(tmp_path: Path) -> None:
    (tmp_path / "one").symlink_to("two")
    (tmp_path / "two").symlink_to("one")
    with pytest.raises(NotPrivate, match="more than 40 links"):
        private_folder(tmp_path / "one", "kinseek")


def test_a_file_in_the_place_of_a_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(NotADirectoryError, match="file is not a folder"):
        private_folder(tmp_path / "file", "kinseek")


@pytest.mark.parametrize(
    ("owner", "bits", "safe"),
    [
        (0, 0o40755, True),
        (0, 0o41777, True),  # /tmp
        (0, 0o40777, False),
        (0, 0o40775, False),
        (os.getuid() if hasattr(os, "getuid") else 0, 0o40755, True),
        (1, 0o40755, False),
        (1, 0o41777, False),
        (0, 0o120777, True),  # A link: who owns it, or its folder, may replace it.
        (1, 0o120777, False),
    ],
)
def test_whose_folders_may_be_on_the_way(owner: int, bits: int, safe: bool) -> None:
    status = os.stat_result((bits, 1, 1, 1, owner, 0, 0, 0, 0, 0))
    if safe:
        private._require_safe(Path("/there"), status)
        return
    with pytest.raises(NotPrivate, match="/there"):
        private._require_safe(Path("/there"), status)


def test_a_sticky_folder_of_the_user_is_refused(tmp_path: Path) -> None:
    if os.getuid() == 0:
        os.chown(tmp_path, ANOTHER, -1)
    tmp_path.chmod(0o1777)
    with pytest.raises(NotPrivate):
        private_folder(tmp_path, "kinseek")


def test_folders_and_files_of_another_user_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = private_folder(tmp_path, "kinseek")
    (folder / "file").write_bytes(b"code")
    (folder / "file").chmod(0o600)
    assert read_private(folder / "file") == b"code"
    # The effective user: that of a program with setuid, and not of whoever starts it. Files that it makes belong to him.
    another = os.geteuid() + 1
    monkeypatch.setattr(os, "geteuid", lambda: another)
    with pytest.raises(NotPrivate, match="belongs to user"):
        private_folder(tmp_path, "kinseek")
    with pytest.raises(NotPrivate, match="file belongs to user"):
        read_private(folder / "file")


SETUID = """
import os, sys
from pathlib import Path
from kinseek.support.private import NotPrivate, private_folder
os.setresuid(int(sys.argv[2]), 0, 0)
try:
    private_folder(Path(sys.argv[1]), "kinseek")
except NotPrivate as error:
    print(error)
"""


@pytest.mark.skipif(
    not hasattr(os, "setresuid") or os.geteuid() != 0, reason="only root becomes another user"
)
def test_a_program_with_setuid_uses_no_folder_of_who_starts_it(tmp_path: Path) -> None:
    (tmp_path / "kinseek").mkdir(mode=0o700)
    os.chown(tmp_path / "kinseek", ANOTHER, ANOTHER)
    command = [sys.executable, "-c", SETUID, str(tmp_path), str(ANOTHER)]
    said = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert said == f"{tmp_path / 'kinseek'} belongs to user {ANOTHER}\n"


@pytest.mark.skipif(os.name == "nt" or os.geteuid() != 0, reason="only root gives folders away")
def test_a_folder_that_another_user_made_first_is_refused(tmp_path: Path) -> None:
    """As it may be in a shared temporary folder."""
    (tmp_path / "kinseek-0").mkdir(mode=0o700)
    os.chown(tmp_path / "kinseek-0", ANOTHER, ANOTHER)
    with pytest.raises(NotPrivate, match=f"kinseek-0 belongs to user {ANOTHER}"):
        private_folder(tmp_path, "kinseek-0", "code")


@pytest.mark.parametrize("bits", [0o620, 0o602, 0o666], ids=oct)
def test_a_file_that_others_may_write_to_is_not_read(tmp_path: Path, bits: int) -> None:
    (tmp_path / "file").write_bytes(b"code")
    (tmp_path / "file").chmod(bits)
    with pytest.raises(NotPrivate, match=rf"others may write to .*/file \(mode {bits:o}\)"):
        read_private(tmp_path / "file")


def test_a_link_is_not_read(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"code")
    (tmp_path / "link").symlink_to("file")
    with pytest.raises(NotPrivate, match="link is a link"):
        read_private(tmp_path / "link")
    (tmp_path / "nowhere").symlink_to("missing")
    with pytest.raises(NotPrivate, match="nowhere is a link"):
        read_private(tmp_path / "nowhere")


@pytest.mark.skipif(sys.platform == "win32", reason="needs named pipes")
def test_only_regular_files_are_read_and_nothing_is_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe", 0o600)
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(OSError, match="is not a regular file"):
            read_private(path)
    with pytest.raises(FileNotFoundError):
        read_private(tmp_path / "missing")


def test_without_user_ids_only_links_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As on Windows, where permissions say nothing."""
    folder = private_folder(tmp_path, "kinseek")
    folder.chmod(0o777)
    (folder / "file").write_bytes(b"code")
    (folder / "file").chmod(0o666)
    monkeypatch.delattr(os, "geteuid")
    assert private_folder(tmp_path, "kinseek") == folder
    assert read_private(folder / "file") == b"code"
    (tmp_path / "link").symlink_to(folder)
    with pytest.raises(NotPrivate, match="is a link"):
        private_folder(tmp_path, "link")


def test_links_are_followed_as_python_does(tmp_path: Path) -> None:
    (tmp_path / "a" / "b").mkdir(parents=True)
    (tmp_path / "link").symlink_to("a/b")
    (tmp_path / "a" / "b" / "up").symlink_to(tmp_path / "a")
    (tmp_path / "gone").symlink_to("missing/file")
    for path in ("link/../x", "link/up/b/up/new/y", "gone", "a/b", "missing/../a"):
        assert resolved(tmp_path / path) == (tmp_path / path).resolve()
    (tmp_path / "itself").symlink_to("itself")
    with pytest.raises(OSError, match="more than 40 links"):
        resolved(tmp_path / "itself")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() != 0, reason="only root gives links away")
@pytest.mark.parametrize("name", ["out.csv", "folder/out.csv"])
def test_a_link_of_another_user_in_a_folder_of_all_is_not_followed(name: str, tmp_path: Path) -> None:
    """Linux itself does not follow it (fs.protected_symlinks) when a file is opened, but `Path.resolve` does."""
    own, shared = tmp_path / "own", tmp_path / "shared"
    own.mkdir()
    shared.mkdir()
    shared.chmod(0o1777)
    (own / "out.csv").write_text("mine")
    link = shared / Path(name).parts[0]
    link.symlink_to(own if link.name == "folder" else own / "out.csv")
    assert output_path(shared / name, "--out") == own / "out.csv"
    os.lchown(link, ANOTHER, ANOTHER)
    with pytest.raises(
        kinseek.InvalidProblem, match=f"is a link of user {ANOTHER} in a folder of several users"
    ):
        output_path(shared / name, "--out")
    with pytest.raises(kinseek.InvalidMap, match=f"is a link of user {ANOTHER} in a folder of several users"):
        maps.open(shared / name)
