"""The files that fuzzing starts from are read as their list says, soon, and nothing of other files gets into an arm."""

from __future__ import annotations

import re
import shutil
import time
from pathlib import Path

import pytest

from fuzz.files import BESIDE, seeds
from fuzz.readers import CORPUS, READERS, judge, kind_of
from kinseek import InvalidRobot
from kinseek.robots import read

LIST = (CORPUS / "README.md").read_text(encoding="utf-8")
ENDS = dict(re.findall(r"^\| `([^`]+)` \|.*\| (loaded|refused) \|$", LIST, re.MULTILINE))
SLOW = 5.0
"""[s] of the processor: the fuzz itself allows ten, of a file that was made worse."""


def test_every_file_stands_in_the_list_and_has_a_reader() -> None:
    files = {path.name for path in CORPUS.iterdir()} - {"README.md"}
    assert files == {*ENDS, *BESIDE}
    assert {kind_of(Path(name)) for name in ENDS} == set(READERS)
    assert all(seeds().values())


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(ENDS))
def test_a_file_ends_as_the_list_says(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    if name.endswith(".xml"):
        pytest.importorskip("mujoco")
    if name.endswith((".srdf", ".scene", ".obstacles.urdf")):
        pytest.importorskip("coal")
    shutil.copytree(CORPUS, tmp_path / "corpus")
    monkeypatch.chdir(tmp_path)
    began = time.process_time()
    for stem in ("", "untrusted_") if name.endswith(".xacro") else ("",):
        path = tmp_path / "corpus" / f"{stem}{name}"
        shutil.copy(CORPUS / name, path)
        assert judge(path) == ENDS[name], stem
    assert time.process_time() - began < SLOW
    assert capfd.readouterr() == ("", "")


def test_what_another_file_holds_gets_nowhere(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("<link name='secret'/>", encoding="utf-8")
    for name in ("outside.urdf", "outside.xacro"):
        text = (CORPUS / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(
            text.replace("file:///etc/hostname", (tmp_path / "secret").as_uri()), encoding="utf-8"
        )
        with pytest.raises(InvalidRobot, match=r"Entity 'e' not defined|an entity that is another file"):
            read(tmp_path / name)


def test_a_corner_that_no_whole_number_of_a_processor_holds_is_refused(tmp_path: Path) -> None:
    pytest.importorskip("coal")
    text = (CORPUS / "room.scene").read_text(encoding="utf-8")
    assert "\n0 2 3\n" in text
    (tmp_path / "case.scene").write_text(text.replace("\n0 2 3\n", f"\n0 2 {'9' * 30}\n"), encoding="utf-8")
    assert judge(tmp_path / "case.scene") == "refused"
