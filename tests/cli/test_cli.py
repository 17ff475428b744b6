"""The command line: what it prints, what it returns, and one clear line for every mistake."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

import kinseek
from kinseek.cli import main
from kinseek.cli.searches import make_search, parameters, searches
from kinseek.cli.words import join_lists
from kinseek.kernels.backend import describe_backend

REACHABLE = ("--at", "-0.3", "0.4", "0")


class Result(NamedTuple):
    code: int
    out: str
    err: str


Run = Callable[..., Result]


@pytest.fixture
def run(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    monkeypatch.setenv("COLUMNS", "100")

    def run_one(*words: str) -> Result:
        with pytest.raises(SystemExit) as ended:
            main(words)
        captured = capfd.readouterr()
        assert isinstance(ended.value.code, int)
        said = [line for line in captured.err.splitlines(keepends=True) if "compiling kernels" not in line]
        return Result(ended.value.code, captured.out, "".join(said))

    return run_one


def test_version(run: Run) -> None:
    assert run("--version")[:2] == (0, f"{kinseek.__version__}\n")


@pytest.mark.parametrize("words", [(), ("--help",)])
def test_help_lists_the_commands(run: Run, words: tuple[str, ...]) -> None:
    code, out, _ = run(*words)
    assert code == 0
    assert all(command in out for command in ("robots", "kernels", "show", "fk", "solve"))


def test_it_says_how_kernels_run(run: Run) -> None:
    assert run("kernels") == (0, f"{describe_backend()}\n", "")


def test_solve_proves_what_it_misses(run: Run) -> None:
    far = ("solve", "ur5e", "--at", "0.9", "0.2", "0.5", "--rpy", "180", "0", "0", "--deg")
    missed, proved = run(*far, "--json"), run(*far, "--prove", "--json")
    assert (missed.code, proved.code) == (1, 1)
    assert json.loads(missed.out)["status"] == "BEST_EFFORT"
    assert json.loads(proved.out)["status"] == "PROVED_UNREACHABLE"
    assert run("solve", "planar2", *REACHABLE, "--position-only", "--prove").code == 0


def test_robots_lists_every_arm(run: Run) -> None:
    code, out, _ = run("robots")
    assert code == 0
    lines = {line.split()[0]: line for line in out.splitlines() if line[:1].isalnum()}
    assert lines["panda"].split()[1:] == ["7", "Franka", "Emika", "Panda"]
    assert {"planar2", "cylindrical3", "scara4", "elbow6", "ur5e"} <= set(lines)


PLACE = ("--at", "0.573867", "0.450081", "-0.100000")
SHOWN = {
    "units": (
        ("show", "scara4"),
        "joint +kind +lower rad or m +upper rad or m +lower deg or mm +upper deg or mm",
    ),
    "limits of a slide": (("show", "scara4"), r"quill +prismatic +0.000000 +0.250000 +0.000 +250.000"),
    "limits of a turn": (("show", "scara4"), r"wrist +revolute +0.000000 +6.283185 +0.000 +360.000"),
    "no limits": (("show", "gen3"), r"joint_1 +continuous +none +none +none +none +1.396"),
    "speed": (("show", "ur5e"), r"shoulder_pan_joint .* 3.142\n"),
    "no speed": (("show", "puma560"), r"j1 .* -\n"),
    "a part": (
        ("show", "panda", "--base", "panda_link2", "--tip", "panda_link5"),
        "3 joints, base panda_link2, tip panda_link5",
    ),
    "fk: position": (
        ("fk", "planar2", "0", "0"),
        "position +x y z in m +0.750000000 +0.000000000 +0.000000000",
    ),
    "fk: quaternion": (("fk", "planar2", "0", "0"), "quaternion +w x y z +1.000000000 +0.000000000"),
    "solve: a turn": (
        ("solve", "planar2", *REACHABLE, "--position-only"),
        r"joint1 +-?\d\.\d{6} rad +-?\d+\.\d{3} deg +\d\.\d{6} rad = \d+\.\d{3} deg",
    ),
    "solve: a slide": (
        ("solve", "scara4", *PLACE, "--position-only"),
        r"quill +0\.\d{6} m +\d+\.\d{3} mm +0\.\d{6} m = \d+\.\d{3} mm",
    ),
    "solve: status": (
        ("solve", "planar2", *REACHABLE, "--position-only"),
        re.escape(str(kinseek.Status.SOLVED)),
    ),
    "solve: work": (("solve", "planar2", *REACHABLE, "--position-only"), r"[\d,]+ FK evaluations"),
}


@pytest.mark.parametrize("case", SHOWN)
def test_what_people_read(case: str, run: Run) -> None:
    words, pattern = SHOWN[case]
    code, out, err = run(*words)
    assert (code, err) == (0, "")
    assert re.search(pattern, out)
    assert "-0.000000000" not in out


def test_reach_of_two_links_lies_between_its_bounds(run: Run) -> None:
    out = run("show", "planar2").out
    least, most = (float(re.search(rf"at {which} +(\d\.\d+) m", out)[1]) for which in ("least", "most"))  # type: ignore[index]
    assert 0.74 < least <= 0.75 <= most < 0.7501


def test_fk_agrees_with_the_library(run: Run) -> None:
    q = [-0.1, 0.2, -0.3, -1.5, 0.5, 1.6, -0.7]
    code, out, _ = run("fk", "panda", *map(str, q), "--json")
    facts = json.loads(out)
    arm = kinseek.load("panda")
    assert code == 0
    assert np.allclose(facts["matrix"], arm.fk(q), atol=1e-15)
    for order in ("quat_wxyz", "quat_xyzw"):
        assert np.allclose(kinseek.pose(facts["position"], **{order: facts[order]}), arm.fk(q), atol=1e-12)


def test_a_calibrated_arm(run: Run, tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_text("kinematics: {forearm: {x: -0.424, y: 0, z: 0, roll: 0.001, pitch: 0, yaw: 0}}\n")
    q = ["0.1", "-1", "1", "0", "0", "0"]
    out = run("fk", "ur5e", *q, "--calibration", str(file), "--json").out
    expected = kinseek.load("ur5e", calibration=file).fk([float(value) for value in q])
    np.testing.assert_allclose(json.loads(out)["matrix"], expected, rtol=0, atol=1e-12)
    assert not np.allclose(
        json.loads(run("fk", "ur5e", *q, "--json").out)["matrix"], expected, rtol=0, atol=1e-4
    )
    code, _, err = run("check", "ur5e", "--calibration", str(file))
    assert (code, "--calibration is not checked" in err) == (2, True)


def test_fk_in_degrees_leaves_metres_alone(run: Run) -> None:
    words = ("fk", "scara4", "90", "-90", "0.1", "45", "--deg", "--json")
    expected = kinseek.load("scara4").fk(np.array([np.pi / 2, -np.pi / 2, 0.1, np.pi / 4]))
    assert np.allclose(json.loads(run(*words).out)["matrix"], expected, atol=1e-12)


def test_json_holds_everything(run: Run) -> None:
    words = ("solve", "gen3", "--at", "0.4", "0.1", "0.5", "--rpy", "3.14", "0", "0")
    code, out, _ = run(*words, "--orientation-tolerance", "0.01", "--position-tolerance", "0.001", "--json")
    facts: dict[str, Any] = json.loads(out)
    arm = kinseek.load("gen3")
    assert set(facts) == {
        *("arm", "base", "tip", "joint_names", "goal", "solver", "success", "status", "sentence"),
        *("q", "joints", "position_error", "orientation_error", "weighted_error", "evaluations"),
        *("nodes_created", "nodes_expanded", "seconds", "proof"),
    }
    assert facts["joint_names"] == list(arm.joint_names)
    assert facts["success"] is (code == 0) is True
    assert facts["status"] == "SOLVED"
    assert facts["sentence"] == str(kinseek.Status.SOLVED)
    reached = arm.fk(facts["q"])
    target = np.array(facts["goal"]["target"])
    assert np.linalg.norm(reached[:3, 3] - target[:3, 3]) == pytest.approx(facts["position_error"], abs=1e-12)
    first, second = facts["joints"][:2]
    assert (first["kind"], first["lower"], first["to_limit"]) == ("continuous", None, None)
    assert second["to_limit"] == pytest.approx(
        min(second["value"] - second["lower"], second["upper"] - second["value"])
    )


def test_free_axes(run: Run) -> None:
    words = ("solve", "ur5e", "--at", "0.4", "0.2", "0.3", "--rpy", "180", "0", "0", "--deg", "--json")
    facts = json.loads(run(*words, "--free", "z,rz").out)
    assert (facts["goal"]["kind"], facts["success"]) == ("box", True)
    T = kinseek.load("ur5e").fk(facts["q"])
    np.testing.assert_allclose(T[:2, 3], [0.4, 0.2], atol=2e-6)
    np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=2e-6)
    code, _, err = run(*words, "--free", "rq")
    assert (code, "unknown axis 'rq'" in err) == (2, True)


def test_out_of_reach_is_exit_code_1(run: Run) -> None:
    code, out, err = run("solve", "planar2", "--at", "5", "0", "0", "--position-only", "--json")
    facts = json.loads(out)
    assert (code, facts["success"], err) == (1, False, "")
    assert facts["position_error"] == pytest.approx(4.25, abs=1e-3)
    assert facts["orientation_error"] is None


@pytest.mark.parametrize(
    "words",
    [
        ("--quat-wxyz", "0.9", "0.1", "-0.2", "0.3"),
        ("--quat-xyzw", "0.1", "-0.2", "0.3", "0.9"),
    ],
)
def test_quaternion_orders(run: Run, words: tuple[str, ...]) -> None:
    facts = json.loads(run("solve", "planar2", *REACHABLE, *words, "--json").out)
    expected = kinseek.pose([-0.3, 0.4, 0.0], quat_wxyz=[0.9, 0.1, -0.2, 0.3])
    assert np.allclose(facts["goal"]["target"], expected, atol=1e-15)


@pytest.mark.parametrize(
    ("words", "turn"),
    [
        (("--rpy", "0.1", "-0.2", "0.3"), {"rpy": [0.1, -0.2, 0.3]}),
        (("--rpy=0.1,-0.2,0.3",), {"rpy": [0.1, -0.2, 0.3]}),
        (("--rpy", "10", "-20", "30", "--deg"), {"rpy": np.deg2rad([10, -20, 30])}),
        (("--rotvec", "-1e-1", "-.2", "0"), {"rotvec": [-0.1, -0.2, 0.0]}),
    ],
)
def test_other_rotations(run: Run, words: tuple[str, ...], turn: dict[str, Any]) -> None:
    facts = json.loads(run("solve", "planar2", *REACHABLE, *words, "--json").out)
    assert np.allclose(facts["goal"]["target"], kinseek.pose([-0.3, 0.4, 0.0], **turn), atol=1e-15)


def test_near_reaches_the_search(run: Run) -> None:
    arm = kinseek.load("planar2")
    near = [1.0, 2.0]
    at = [f"{value}" for value in arm.fk(near)[:3, 3]]
    words = ("solve", "planar2", "--at", *at, "--position-only", "--json", "--solver", "coordinate-descent")
    assert np.allclose(json.loads(run(*words, "--near", "1", "2").out)["q"], near, atol=1e-6)
    degrees = [f"{value}" for value in np.rad2deg(near)]
    assert np.allclose(json.loads(run(*words, "--near", *degrees, "--deg").out)["q"], near, atol=1e-6)


def test_joint_values_by_name(run: Run) -> None:
    words = ("solve", "planar2", *REACHABLE, "--position-only", "--json", "--near")
    plain = json.loads(run(*words, "1", "-2").out)["q"]
    for named in (("joint2=-2,joint1=1",), ("joint2=-2", "joint1=1")):
        assert json.loads(run(*words, *named).out)["q"] == plain
    assert run("fk", "planar2", "joint2=-2", "joint1=1").out == run("fk", "planar2", "1", "-2").out


def test_locked_joints_stay_where_they_are(run: Run) -> None:
    arm = kinseek.load("ur5e")
    at = arm.fk([0.4, -1.2, 1.5, 0.2, 0.9, 0.3])[:3, 3]
    words = ("solve", "ur5e", "--at", *(f"{x!r}" for x in at.tolist()), "--position-only", "--json")
    wrist, elbow = (float(np.rad2deg(angle)) for angle in (0.3, 1.5))
    for lock in (
        ("--lock", "wrist_3_joint=0.3", "elbow_joint=1.5"),
        ("--lock=wrist_3_joint=0.3", "--lock", "elbow_joint=1.5"),
        ("--lock", f"wrist_3_joint={wrist!r},elbow_joint={elbow!r}", "--deg"),
    ):
        code, out, _ = run(*words, *lock)
        facts = json.loads(out)
        assert (code, len(facts["q"])) == (0, 4)
        q = dict(zip(facts["joint_names"], facts["q"], strict=True))
        whole = [
            q.get(name, {"wrist_3_joint": 0.3, "elbow_joint": 1.5}.get(name)) for name in arm.joint_names
        ]
        assert np.allclose(arm.fk(np.array(whole))[:3, 3], at, atol=2e-6)


TOP = ("--at", "0.4", "0.2", "0.3", "--rpy", "180", "0", "0", "--deg")


def test_all_answers(run: Run) -> None:
    facts = json.loads(run("solve", "ur5e", *TOP, "--all", "--json").out)
    arm = kinseek.load("ur5e")
    expected = arm.branches(kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0.0, 0.0]))
    assert np.array_equal([each["q"] for each in facts["branches"]], expected.q)
    assert (facts["sampled"], facts["complete"], len(expected) > 1) == (False, False, True)
    code, out, _ = run("solve", "ur5e", *TOP, "--all")
    assert code == 0
    rows = [line.split() for line in out.splitlines() if re.match(r" *\d+ +-?\d", line)]
    assert np.allclose([[float(word) for word in row[1:7]] for row in rows], expected.q, atol=1e-6)
    assert f"{len(expected)} solutions" in out
    near = [f"{value}" for value in expected.q[3] + 0.01]
    first = json.loads(
        run("solve", "ur5e", *TOP[:-1], "--rpy=3.141592653589793,0,0", "--all", "--json", "--near", *near).out
    )
    assert np.allclose(first["branches"][0]["q"], expected.q[3], atol=1e-5)
    assert len(json.loads(run("solve", "ur5e", *TOP, "--all", "--count", "2", "--json").out)["branches"]) == 2


def test_all_answers_proved(run: Run) -> None:
    words = ("solve", "planar2", *REACHABLE, "--position-only", "--all")
    assert "2 solutions; proved to be all" in run(*words, "--prove").out
    code, out, _ = run("solve", "planar2", "--at", "5", "0", "0", "--position-only", "--all")
    assert (code, "0 solutions" in out) == (1, True)


@pytest.mark.parametrize("order", ["mid-range", "limits", "dexterity"])
def test_the_preferred_answer(run: Run, order: Any) -> None:
    facts = json.loads(run("solve", "ur5e", *TOP, "--prefer", order, "--json").out)
    expected = kinseek.load("ur5e").branches(
        kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0.0, 0.0]), order=order
    )
    assert np.allclose(facts["q"], expected.q[0], atol=1e-9)


def test_the_preferred_posture(run: Run) -> None:
    T = kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0.0, 0.0])
    arm, wanted = kinseek.load("ur5e"), {"elbow": "down", "wrist": "flip"}
    facts = json.loads(run("solve", "ur5e", *TOP, "--prefer", "elbow=down,wrist=flip", "--json").out)
    assert np.allclose(facts["q"], arm.ik(T, prefer=wanted).q, atol=1e-9)
    near = ("--near", *map(str, facts["q"]))
    again = json.loads(run("solve", "ur5e", *TOP, *near, "--prefer", "elbow=down", "--json").out)
    assert np.allclose(again["q"], facts["q"], atol=1e-9)
    panda = kinseek.load("panda")
    for words, angle in (((), 0.5), (("--deg",), np.deg2rad(0.5))):
        at = ("--at", "0.4", "0.1", "0.5", "--quat-wxyz", "0", "1", "0", "0")
        q = json.loads(run("solve", "panda", *at, *words, "--prefer", "arm_angle=0.5", "--json").out)["q"]
        read = panda.ik(panda.fk(q), near=q).configuration["arm_angle"]
        assert read == pytest.approx(angle, abs=1e-8)


def test_search_options_reach_the_search(run: Run) -> None:
    words = ("--solver", "divide-and-conquer", "--branching-factor", "100", "--breadth", "3,2", "--no-wrap")
    facts = json.loads(run("solve", "planar2", *REACHABLE, "--position-only", *words, "--json").out)
    expected = kinseek.DivideAndConquer(branching_factor=100, breadth=(3, 2), wrap=False)
    assert facts["solver"] == repr(expected)
    assert facts["nodes_expanded"] > 0


@pytest.mark.parametrize(
    ("given", "expected"),
    [("2", 2), ("2.5", 2.5), ("3,3,1", (3, 3, 1)), ("tuned", "tuned")],
    ids=["CB", "mean", "BT", "tuned"],
)
def test_the_ways_to_give_breadth(given: str, expected: object) -> None:
    search = make_search("divide-and-conquer", {"breadth": given, "children": "none"})
    assert isinstance(search, kinseek.DivideAndConquer)
    assert search.breadth == expected


@pytest.mark.parametrize(
    ("given", "expected"), [("0.25", 0.25), ("none", None), ("none,0.5", (None, 0.5)), ("0,0.5", (0.0, 0.5))]
)
def test_an_offset_is_one_number_or_one_a_joint_or_none(given: str, expected: object) -> None:
    search = make_search("divide-and-conquer", {"offset": given})
    assert isinstance(search, kinseek.DivideAndConquer)
    assert search.offset == expected


@pytest.mark.parametrize("search", searches())
def test_every_plain_field_is_an_option_with_help(run: Run, search: str) -> None:
    out = run("solve", "--help").out
    own = parameters(search)
    assert all(parameter.option in out for parameter in own.values())
    plain = [f for f in fields(searches()[search]) if isinstance(f.default, (int, float, str))]  # type: ignore[arg-type]
    assert {field.name for field in plain} <= set(own)


def test_help_comes_from_the_docstrings_below_the_fields() -> None:
    assert (
        parameters("blind-search")["shrink"].help
        == "Factor on Δ if no combination improves; None keeps Δ fixed, as the paper does, and ends the search there."
    )


@pytest.mark.parametrize("search", searches())
def test_every_search_runs_from_the_command_line(run: Run, search: str) -> None:
    code, out, err = run("solve", "planar2", *REACHABLE, "--position-only", "--solver", search, "--json")
    assert code in (0, 1), err
    assert json.loads(out)["solver"].startswith(searches()[search].__name__)


MISUSE = {
    "no such command": (("frob",), "frob"),
    "misspelt command": (("slove", "ur5e"), "did you mean 'solve'"),
    "no arm": (("solve",), "ARM"),
    "unknown robot": (("show", "pandda"), "did you mean 'panda'"),
    "upper case": (("show", "UR5E"), "did you mean 'ur5e'?"),
    "other case": (("show", "Panda"), "did you mean 'panda'?"),
    "missing file": (("show", "nowhere.urdf"), "nowhere.urdf"),
    "unknown link": (("show", "panda", "--tip", "hand"), "unknown link 'hand'"),
    "no such option": (("show", "panda", "--frob", "1"), "--frob"),
    "fk: too few": (("fk", "panda", "1", "2"), "needs 7 numbers, got 2"),
    "fk: a word": (("fk", "planar2", "1", "x"), "'x' is not a number"),
    "fk: NaN": (("fk", "planar2", "1", "nan"), "NaN"),
    "no position": (("solve", "planar2", "--position-only"), "--at"),
    "no rotation": (("solve", "planar2", *REACHABLE), "exactly one of --rpy"),
    "two rotations": (
        ("solve", "planar2", *REACHABLE, "--rpy", "0", "0", "0", "--position-only"),
        "--rpy and",
    ),
    "two numbers": (("solve", "planar2", "--at", "0.3", "0.4", "--position-only"), "needs 3 numbers, got 2"),
    "four numbers": (("solve", "planar2", *REACHABLE, "7", "--position-only"), "needs 3 numbers, got 4"),
    "a word": (("solve", "planar2", "--at", "0.3", "up", "0", "--position-only"), "'up' is not a number"),
    "NaN": (("solve", "planar2", "--at", "nan", "0", "0", "--position-only"), "NaN"),
    "zero quaternion": (
        ("solve", "planar2", *REACHABLE, "--quat-wxyz", "0", "0", "0", "0"),
        "zero quaternion",
    ),
    "near": (("solve", "planar2", *REACHABLE, "--position-only", "--near", "1"), "needs 2 numbers, got 1"),
    "near: half": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--near", "joint1=1"),
        "--near: no value for joint 'joint2'; given: joint1",
    ),
    "near: unknown": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--near", "joint1=1,joint_2=2"),
        "unknown joint 'joint_2'; did you mean 'joint2'",
    ),
    "near: twice": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--near", "joint1=1", "joint1=2"),
        "names the joint 'joint1' twice",
    ),
    "near: no number": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--near", "joint1=1", "joint2=x"),
        "--near joint2: 'x' is not a number",
    ),
    "lock: no name": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--lock", "1"),
        "takes JOINT=VALUE",
    ),
    "lock: unknown": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--lock", "elbow=1"),
        "unknown joint 'elbow'",
    ),
    "lock: all": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--lock", "joint1=1", "joint2=1"),
        "locked",
    ),
    "prefer": (("solve", "planar2", *REACHABLE, "--position-only", "--prefer", "limit"), "'limits'"),
    "posture": (("solve", "ur5e", *REACHABLE, "--position-only", "--prefer", "elbow=top"), "Valid: down, up"),
    "no posture": (("solve", "ur5e", *REACHABLE, "--position-only", "--prefer", "elbow=up,x"), "got 'x'"),
    "a posture twice": (
        ("solve", "ur5e", *REACHABLE, "--position-only", "--prefer", "elbow=up,elbow=up"),
        "names 'elbow' twice",
    ),
    "a posture of all": (
        ("solve", "ur5e", *REACHABLE, "--position-only", "--all", "--prefer", "elbow=up"),
        "cannot be combined with --all",
    ),
    "near and prefer": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--near", "1", "1", "--prefer", "limits"),
        "--near and --prefer cannot be combined",
    ),
    "count of none": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--all", "--count", "0"),
        "--count",
    ),
    "count alone": (("solve", "planar2", *REACHABLE, "--position-only", "--count", "2"), "add --all"),
    "all with a search": (
        ("solve", "planar2", *REACHABLE, "--position-only", "--all", "--solver", "brute-force"),
        "cannot be combined with --solver or --trace",
    ),
    "tolerance": (("solve", "planar2", *REACHABLE, "--position-only", "--position-tolerance", "-1"), ">= 0"),
}


@pytest.mark.parametrize(("words", "said"), MISUSE.values(), ids=MISUSE)
def test_misuse_is_one_line_and_exit_code_2(run: Run, words: tuple[str, ...], said: str) -> None:
    check_misuse(run(*words), said)


SEARCH_MISUSE = {
    "unknown": (("--solver", "brut-force"), "did you mean 'brute-force'"),
    "foreign option": (("--solver", "brute-force", "--divisions", "3"), "Its options: --branching-factor"),
    "no search": (("--divisions", "3"), "--divisions needs --solver divide-and-conquer"),
    "no number": (("--solver", "divide-and-conquer", "--divisions", "x"), "--divisions takes N, got 'x'"),
    "range": (("--solver", "divide-and-conquer", "--divisions", "1"), "at least 2"),
    "breadths": (("--solver", "divide-and-conquer", "--breadth", "1,2,3"), "got 3"),
    "memory": (
        ("--solver", "divide-and-conquer", "--tree", "static", "--branching-factor", "9" * 15),
        "this machine has",
    ),
}


@pytest.mark.parametrize(("words", "said"), SEARCH_MISUSE.values(), ids=SEARCH_MISUSE)
def test_misuse_of_searches(run: Run, words: tuple[str, ...], said: str) -> None:
    check_misuse(run("solve", "planar2", *REACHABLE, "--position-only", *words), said)


def check_misuse(result: Result, said: str) -> None:
    assert result.code == 2
    assert result.out == ""
    assert said in result.err
    assert result.err.startswith("kinseek: ")
    assert result.err.count("\n") == 1


def test_without_the_extra_it_says_how_to_install_it(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delitem(sys.modules, "kinseek.cli.program", raising=False)
    monkeypatch.setitem(sys.modules, "click", None)
    result = run("robots")
    assert (result.code, result.out) == (2, "")
    assert "pip install 'kinseek[cli]'" in result.err


def test_gather_leaves_other_words_alone() -> None:
    words = ["solve", "--at", "-1", "2", "-3e-1", "panda", "--near", "0", "-1", "--json"]
    assert join_lists(words) == ["solve", "--at=-1 2 -3e-1", "panda", "--near=0 -1", "--json"]
