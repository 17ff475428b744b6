"""``kinseek view`` and ``kinseek completion``."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
import types
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest

import kinseek
from command_line import CommandLine
from kinseek.cli.program import run


def shown_by(monkeypatch: pytest.MonkeyPatch, show: Callable[..., None]) -> None:
    """Have a function called in the place of the viewer's."""
    monkeypatch.setitem(sys.modules, "kinseek.viewer", types.SimpleNamespace(show=show))


def test_view_hands_the_arm_on(
    monkeypatch: pytest.MonkeyPatch, cli: CommandLine, capfd: pytest.CaptureFixture[str]
) -> None:
    shown: list[Any] = []
    usual = {"host": "127.0.0.1", "port": 8080, "share": False, "open_browser": None, "packages": {}}
    usual |= {"scene": None, "clearance": 0.0}

    def show(arm: Any, **options: Any) -> None:
        shown.append((arm.name, arm.tip, options))
        print("shown at http://127.0.0.1:9000", flush=True)
        assert "shown at" in capfd.readouterr().out  # At once, not at the end.

    shown_by(monkeypatch, show)
    cli("view panda")
    assert shown.pop() == ("panda", "panda_link8", usual)
    cli("view panda --tip panda_link5 --host 0.0.0.0 --port 9000 --no-browser --share --package a=/b=c")
    other = {"host": "0.0.0.0", "port": 9000, "share": True, "open_browser": False, "packages": {"a": "/b=c"}}
    assert shown.pop() == ("panda", "panda_link5", usual | other)
    for wrong, said in (("--port 70000", "70000"), ("--package a", "--package takes NAME=FOLDER")):
        assert said in cli.refused("view panda", wrong)
    pytest.importorskip("pinocchio")
    cli("view panda --scene self --capsules 0.05 --clearance 0.01")
    _, _, options = shown.pop()
    assert options["scene"].fits(kinseek.load("panda").mechanism)
    assert options["clearance"] == 0.01
    assert "--clearance needs a scene" in cli.refused("view panda --clearance 0.01")


def test_without_the_extra_it_says_how_to_install_it(
    monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)
    assert "pip install 'kinseek[view]'" in cli.refused("view panda --no-browser --port 0")


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_for_a_shell(shell: str, cli: CommandLine) -> None:
    if shell == "bash" and shutil.which("bash") is None:
        pytest.skip("no bash here")
    assert "_KINSEEK_COMPLETE" in cli("completion", shell).out


def test_an_unknown_shell(cli: CommandLine) -> None:
    assert "did you mean 'bash'" in cli.refused("completion bsh")


COMPLETED = {
    "a command": ("kinseek so", {"solve"}),
    "an arm": ("kinseek show ur10e_", {"ur10e_calibrated", "ur10e_rail"}),
    "an option": ("kinseek solve ur5e --quat", {"--quat-wxyz", "--quat-xyzw"}),
    "a search": ("kinseek solve ur5e --at -0.3 0.4 0.5 --solver b", {"brute-force", "blind-search"}),
    "a joint": ("kinseek solve ur5e --near should", {"shoulder_pan_joint=", "shoulder_lift_joint="}),
    "a joint of no arm": ("kinseek solve nowhere --lock should", set[str]()),
    "a preference": ("kinseek solve ur5e --prefer l", {"limits"}),
    "a processor": ("kinseek export ur5e --target x86", {"x86-64"}),
}


def completed(words: list[str]) -> str:
    """What the program prints for a shell that completes the last word."""
    environment = {
        **os.environ,
        "COMP_WORDS": " ".join(words),
        "COMP_CWORD": str(len(words) - 1),
        "_KINSEEK_COMPLETE": "bash_complete",
    }
    done = subprocess.run(
        [sys.executable, "-m", "kinseek"], capture_output=True, text=True, check=True, env=environment
    )
    assert done.stderr == ""
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("case", COMPLETED)
def test_what_is_completed(case: str) -> None:
    line, words = COMPLETED[case]
    assert {entry.partition(",")[2] for entry in completed(line.split()).split()} == words


@pytest.mark.slow
def test_a_name_that_a_shell_would_act_on_is_not_completed(tmp_path: Path) -> None:
    """A shell inserts the word unquoted: `$(…)` in it would run as soon as the line does."""
    hostile = [
        "a$(touch pwned)",
        "b`id`",
        "c;ls",
        "d\nplain,e",
        "f\x9b31m",
        "g h",
        "i*",
        "j~",
        "k'",
        'l"',
        "m\u202e",
    ]
    names = [*hostile, "shoulder/lift.1:z-1"]
    links = "".join(f'<link name="l{i}"/>' for i in range(len(names) + 1))
    joints = "".join(
        f"<joint name={quoteattr(name)} type='continuous'><parent link='l{i}'/><child link='l{i + 1}'/></joint>"
        for i, name in enumerate(names)
    )
    (tmp_path / "in.urdf").write_text(f"<robot name='r'>{links}{joints}</robot>", encoding="utf-8")
    assert kinseek.load(tmp_path / "in.urdf").joint_names == tuple(names)
    assert (
        completed(["kinseek", "solve", f"{tmp_path / 'in.urdf'}", "--near", ""])
        == "plain,shoulder/lift.1:z-1=\n"
    )


@pytest.mark.slow
def test_completion_prints_no_warning(tmp_path: Path) -> None:
    """A shell shows it below the line that is being typed."""
    text = (
        '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute"><parent link="a"/>'
        '<child link="b"/><limit lower="-90" upper="90"/></joint></robot>'
    )
    (tmp_path / "in.urdf").write_text(text, encoding="utf-8")
    assert completed(["kinseek", "solve", f"{tmp_path / 'in.urdf'}", "--near", ""]) == "plain,j=\n"


@pytest.mark.slow
def test_completion_trusts_no_xacro_file(tmp_path: Path) -> None:
    """`--untrusted` may follow on the line, and a key is no consent."""
    text = """<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="a"/><link name="b"/>
        <joint name="elbow" type="revolute"><parent link="a"/><child link="b"/>
        <limit lower="-1" upper="${VALUE}" effort="1" velocity="1"/></joint></robot>"""
    ways = "[c for c in [].__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close'][0].__init__.__globals__"
    path, made = tmp_path / "in.urdf.xacro", tmp_path / "made"
    path.write_text(text.replace("VALUE", f"{ways}['mkdir']('{made}') or 1.0"), encoding="utf-8")
    assert not completed(["kinseek", "solve", str(path), "--near", ""]).strip()
    assert not made.exists()
    path.write_text(text.replace("VALUE", "radians(60)"), encoding="utf-8")
    assert completed(["kinseek", "solve", str(path), "--near", ""]) == "plain,elbow=\n"


@pytest.mark.parametrize(
    ("error", "code", "said"),
    [
        (BrokenPipeError(32, "Broken pipe"), 141, ""),
        (
            OSError(28, "No space left on device"),
            2,
            "kinseek: cannot write the output: No space left on device\n",
        ),
        (OSError(13, "Permission denied", "a\x1bb"), 2, "kinseek: 'a\\x1bb': Permission denied\n"),
    ],
)
def test_view_whose_output_cannot_be_written_ends_in_a_line(
    error: OSError, code: int, said: str, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    def show(arm: Any, **options: Any) -> None:
        raise error

    shown_by(monkeypatch, show)
    monkeypatch.setattr(sys, "stdout", io.StringIO())  # One without a file, as in a notebook.
    assert cli("view panda", code=code).err == said


def test_view_prints_letters_that_the_terminal_does_not_have(monkeypatch: pytest.MonkeyPatch) -> None:
    shown_by(monkeypatch, lambda arm, **options: print("\N{OHM SIGN}"))
    written = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(written, "ascii"))
    assert run(["view", "panda"]) == 0
    sys.stdout.flush()
    assert written.getvalue() == b"\\u2126\n"
