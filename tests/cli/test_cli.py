"""The command line: what it prints, what it returns, and one clear line for every mistake."""

from __future__ import annotations

import re
import sys
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from command_line import CommandLine
from kinseek.branches.order import ORDERS
from kinseek.cli.searches import make_search, parameters, searches
from kinseek.cli.words import join_lists
from kinseek.kernels.backend import describe_backend

REACHABLE = "--at -0.3 0.4 0"
PLANAR = f"solve planar2 {REACHABLE} --position-only"
UR5E = f"solve ur5e {REACHABLE} --position-only"
DOWN = "solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg"
DOWN_POSE = kinseek.pose([0.4, 0.2, 0.3], rpy=[np.pi, 0.0, 0.0])


def test_version(cli: CommandLine) -> None:
    assert cli("--version").out == f"{kinseek.__version__}\n"


@pytest.mark.parametrize("words", ["", "--help"])
def test_help_lists_the_commands(cli: CommandLine, words: str) -> None:
    out = cli(words).out
    assert all(command in out for command in ("robots", "kernels", "show", "fk", "solve"))


def test_it_says_how_kernels_run(cli: CommandLine) -> None:
    assert cli("kernels") == (f"{describe_backend()}\n", "")


def test_solve_proves_what_it_misses(cli: CommandLine) -> None:
    far = "solve ur5e --at 0.9 0.2 0.5 --rpy 180 0 0 --deg --json"
    assert cli(far, code=1).facts["status"] == "BEST_EFFORT"
    assert cli(far, "--prove", code=1).facts["status"] == "PROVED_UNREACHABLE"
    cli(PLANAR, "--prove")


def test_robots_lists_every_arm(cli: CommandLine) -> None:
    lines = {line.split()[0]: line for line in cli("robots").out.splitlines() if line[:1].isalnum()}
    assert lines["panda"].split()[1:] == ["7", "Franka", "Emika", "Panda"]
    assert {"planar2", "cylindrical3", "scara4", "elbow6", "ur5e"} <= set(lines)


SHOWN = {
    "units": (
        "show scara4",
        "joint +kind +lower rad or m +upper rad or m +lower deg or mm +upper deg or mm",
    ),
    "limits of a slide": ("show scara4", r"quill +prismatic +0.000000 +0.250000 +0.000 +250.000"),
    "limits of a turn": ("show scara4", r"wrist +revolute +0.000000 +6.283185 +0.000 +360.000"),
    "no limits": ("show gen3", r"joint_1 +continuous +none +none +none +none +1.396"),
    "speed": ("show ur5e", r"shoulder_pan_joint .* 3.142\n"),
    "no speed": ("show puma560", r"j1 .* -\n"),
    "a part": (
        "show panda --base panda_link2 --tip panda_link5",
        "3 joints, base panda_link2, tip panda_link5",
    ),
    "fk: position": ("fk planar2 0 0", "position +x y z in m +0.750000000 +0.000000000 +0.000000000"),
    "fk: quaternion": ("fk planar2 0 0", "quaternion +w x y z +1.000000000 +0.000000000"),
    "solve: a turn": (PLANAR, r"joint1 +-?\d\.\d{6} rad +-?\d+\.\d{3} deg +\d\.\d{6} rad = \d+\.\d{3} deg"),
    "solve: a slide": (
        "solve scara4 --at 0.573867 0.450081 -0.100000 --position-only",
        r"quill +0\.\d{6} m +\d+\.\d{3} mm +0\.\d{6} m = \d+\.\d{3} mm",
    ),
    "solve: status": (PLANAR, re.escape(str(kinseek.Status.SOLVED))),
    "solve: work": (PLANAR, r"[\d,]+ FK evaluations"),
}


@pytest.mark.parametrize("case", SHOWN)
def test_what_people_read(case: str, cli: CommandLine) -> None:
    line, pattern = SHOWN[case]
    out, err = cli(line)
    assert err == ""
    assert re.search(pattern, out)
    assert "-0.000000000" not in out


def test_reach_of_two_links_lies_between_its_bounds(cli: CommandLine) -> None:
    out = cli("show planar2").out
    least, most = (float(re.search(rf"at {which} +(\d\.\d+) m", out)[1]) for which in ("least", "most"))  # type: ignore[index]
    assert 0.74 < least <= 0.75 <= most < 0.7501


def test_fk_agrees_with_the_library(cli: CommandLine) -> None:
    q = [-0.1, 0.2, -0.3, -1.5, 0.5, 1.6, -0.7]
    facts, arm = cli("fk panda", *q, "--json").facts, kinseek.load("panda")
    assert np.allclose(facts["matrix"], arm.fk(q), atol=1e-15)
    for order in ("quat_wxyz", "quat_xyzw"):
        assert np.allclose(kinseek.pose(facts["position"], **{order: facts[order]}), arm.fk(q), atol=1e-12)


def test_a_calibrated_arm(cli: CommandLine, tmp_path: Path) -> None:
    file = tmp_path / "c.yaml"
    file.write_text("kinematics: {forearm: {x: -0.424, y: 0, z: 0, roll: 0.001, pitch: 0, yaw: 0}}\n")
    plain = "fk ur5e 0.1 -1 1 0 0 0 --json"
    expected = kinseek.load("ur5e", calibration=file).fk([0.1, -1, 1, 0, 0, 0])
    found = cli(plain, "--calibration", file).facts["matrix"]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)
    assert not np.allclose(cli(plain).facts["matrix"], expected, rtol=0, atol=1e-4)
    assert "--calibration is not checked" in cli.refused("check ur5e --calibration", file)


def test_fk_in_degrees_leaves_metres_alone(cli: CommandLine) -> None:
    expected = kinseek.load("scara4").fk(np.array([np.pi / 2, -np.pi / 2, 0.1, np.pi / 4]))
    assert np.allclose(cli("fk scara4 90 -90 0.1 45 --deg --json").facts["matrix"], expected, atol=1e-12)


def test_where_no_solution_is_found_there_are_not_infinitely_many(cli: CommandLine) -> None:
    said = cli("solve ur5e --at 9 0.2 0.3 --position-only --all", code=1).out
    assert "no solution found; not proved that there is none" in said
    assert "infinitely" not in said


def test_json_holds_everything(cli: CommandLine) -> None:
    tolerances = "--orientation-tolerance 0.01 --position-tolerance 0.001"
    facts = cli("solve gen3 --at 0.4 0.1 0.5 --rpy 3.14 0 0", tolerances, "--json").facts
    arm = kinseek.load("gen3")
    assert set(facts) == {
        *("arm", "base", "tip", "joint_names", "goal", "solver", "success", "status", "sentence"),
        *("q", "joints", "position_error", "orientation_error", "weighted_error", "evaluations"),
        *("nodes_created", "nodes_expanded", "seconds", "proof"),
    }
    assert facts["joint_names"] == list(arm.joint_names)
    assert facts["success"] is True
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


def test_free_axes(cli: CommandLine) -> None:
    facts = cli(DOWN, "--free z,rz --json").facts
    assert (facts["goal"]["kind"], facts["success"]) == ("box", True)
    T = kinseek.load("ur5e").fk(facts["q"])
    np.testing.assert_allclose(T[:2, 3], [0.4, 0.2], atol=2e-6)
    np.testing.assert_allclose(T[:3, 2], [0, 0, -1], atol=2e-6)
    assert "unknown axis 'rq'" in cli.refused(DOWN, "--free rq")


def test_out_of_reach_is_exit_code_1(cli: CommandLine) -> None:
    ended = cli("solve planar2 --at 5 0 0 --position-only --json", code=1)
    facts = ended.facts
    assert (facts["success"], ended.err) == (False, "")
    assert facts["position_error"] == pytest.approx(4.25, abs=1e-3)
    assert facts["orientation_error"] is None


TURN = {"quat_wxyz": [0.9, 0.1, -0.2, 0.3]}
ANGLES = {"rpy": [0.1, -0.2, 0.3]}


@pytest.mark.parametrize(
    ("words", "turn"),
    [
        ("--quat-wxyz 0.9 0.1 -0.2 0.3", TURN),
        ("--quat-xyzw 0.1 -0.2 0.3 0.9", TURN),
        ("--rpy 0.1 -0.2 0.3", ANGLES),
        ("--rpy=0.1,-0.2,0.3", ANGLES),
        ("--rpy 10 -20 30 --deg", {"rpy": np.deg2rad([10, -20, 30])}),
        ("--rotvec -1e-1 -.2 0", {"rotvec": [-0.1, -0.2, 0.0]}),
    ],
)
def test_every_way_to_give_a_rotation(cli: CommandLine, words: str, turn: dict[str, Any]) -> None:
    # The hand of an arm in a plane does not turn in this way: what counts is the goal.
    facts = cli("solve planar2", REACHABLE, words, "--json", code=1).facts
    assert np.allclose(facts["goal"]["target"], kinseek.pose([-0.3, 0.4, 0.0], **turn), atol=1e-15)


def test_near_reaches_the_search(cli: CommandLine) -> None:
    arm = kinseek.load("planar2")
    near = [1.0, 2.0]
    at = arm.fk(near)[:3, 3]
    for words in (["--near", *near], ["--near", *np.rad2deg(near), "--deg"]):
        search = "--position-only --json --solver coordinate-descent"
        found = cli("solve planar2 --at", *at, search, *words).facts["q"]
        assert np.allclose(found, near, atol=1e-6)


def test_joint_values_by_name(cli: CommandLine) -> None:
    plain = cli(PLANAR, "--json --near 1 -2").facts["q"]
    for named in ("joint2=-2,joint1=1", "joint2=-2 joint1=1"):
        assert cli(PLANAR, "--json --near", named).facts["q"] == plain
    assert cli("fk planar2 joint2=-2 joint1=1") == cli("fk planar2 1 -2")


def test_locked_joints_stay_where_they_are(cli: CommandLine) -> None:
    arm = kinseek.load("ur5e")
    at = arm.fk([0.4, -1.2, 1.5, 0.2, 0.9, 0.3])[:3, 3]
    locked = {"wrist_3_joint": 0.3, "elbow_joint": 1.5}
    wrist, elbow = (float(np.rad2deg(angle)) for angle in locked.values())
    for lock in (
        "--lock wrist_3_joint=0.3 elbow_joint=1.5",
        "--lock=wrist_3_joint=0.3 --lock elbow_joint=1.5",
        f"--lock wrist_3_joint={wrist!r},elbow_joint={elbow!r} --deg",
    ):
        facts = cli("solve ur5e --at", *at, "--position-only --json", lock).facts
        assert len(facts["q"]) == 4
        whole = dict(zip(facts["joint_names"], facts["q"], strict=True)) | locked
        assert np.allclose(arm.fk(whole)[:3, 3], at, atol=2e-6)


def test_all_answers(cli: CommandLine) -> None:
    facts = cli(DOWN, "--all --json").facts
    expected = kinseek.load("ur5e").branches(DOWN_POSE)
    assert np.array_equal([each["q"] for each in facts["branches"]], expected.q)
    assert (facts["sampled"], facts["complete"], len(expected) > 1) == (False, False, True)
    out = cli(DOWN, "--all").out
    rows = [line.split() for line in out.splitlines() if re.match(r" *\d+ +-?\d", line)]
    assert np.allclose([[float(word) for word in row[1:7]] for row in rows], expected.q, atol=1e-6)
    assert f"{len(expected)} solutions" in out
    near = expected.q[3] + 0.01
    turn = "--at 0.4 0.2 0.3 --rpy=3.141592653589793,0,0"
    first = cli("solve ur5e", turn, "--all --json --near", *near).facts["branches"][0]["q"]
    assert np.allclose(first, expected.q[3], atol=1e-5)
    assert len(cli(DOWN, "--all --count 2 --json").facts["branches"]) == 2


def test_all_answers_proved(cli: CommandLine) -> None:
    assert "2 solutions; proved to be all" in cli(PLANAR, "--all --prove").out
    assert "0 solutions" in cli("solve planar2 --at 5 0 0 --position-only --all", code=1).out


@pytest.mark.parametrize("order", ORDERS)
def test_the_preferred_answer(cli: CommandLine, order: Any) -> None:
    expected = kinseek.load("ur5e").branches(DOWN_POSE, order=order)
    assert np.allclose(cli(DOWN, "--json --prefer", order).facts["q"], expected.q[0], atol=1e-9)


def test_the_preferred_posture(cli: CommandLine) -> None:
    expected = kinseek.load("ur5e").ik(DOWN_POSE, prefer={"elbow": "down", "wrist": "flip"}).q
    found = cli(DOWN, "--prefer elbow=down,wrist=flip --json").facts["q"]
    assert np.allclose(found, expected, atol=1e-9)
    again = cli(DOWN, "--near", *found, "--prefer elbow=down --json").facts["q"]
    assert np.allclose(again, found, atol=1e-9)
    panda = kinseek.load("panda")
    for words, angle in (("", 0.5), ("--deg", np.deg2rad(0.5))):
        at = "--at 0.4 0.1 0.5 --quat-wxyz 0 1 0 0"
        q = cli("solve panda", at, words, "--prefer arm_angle=0.5 --json").facts["q"]
        read = panda.ik(panda.fk(q), near=q).configuration["arm_angle"]
        assert read == pytest.approx(angle, abs=1e-8)


def test_search_options_reach_the_search(cli: CommandLine) -> None:
    search = "--solver divide-and-conquer --branching-factor 100 --breadth 3,2 --no-wrap"
    facts = cli(PLANAR, search, "--json", code=1).facts
    expected = kinseek.DivideAndConquer(branching_factor=100, breadth=(3, 2), wrap=False)
    assert facts["solver"] == repr(expected)
    assert facts["nodes_expanded"] > 0


@pytest.mark.parametrize(
    ("name", "given", "expected"),
    [
        ("breadth", "2", 2),
        ("breadth", "2.5", 2.5),
        ("breadth", "3,3,1", (3, 3, 1)),
        ("breadth", "tuned", "tuned"),
        ("offset", "0.25", 0.25),
        ("offset", "none", None),
        ("offset", "none,0.5", (None, 0.5)),
        ("offset", "0,0.5", (0.0, 0.5)),
    ],
)
def test_every_way_to_give_a_parameter(name: str, given: str, expected: object) -> None:
    search = make_search("divide-and-conquer", {name: given, "children": "none"})
    assert isinstance(search, kinseek.DivideAndConquer)
    assert getattr(search, name) == expected


@pytest.mark.parametrize("search", searches())
def test_every_plain_field_is_an_option_with_help(cli: CommandLine, search: str) -> None:
    out = cli("solve --help").out
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
def test_every_search_runs_from_the_command_line(cli: CommandLine, search: str) -> None:
    facts = cli(PLANAR, "--json --solver", search, code=(0, 1)).facts
    assert facts["solver"].startswith(searches()[search].__name__)


MISUSE = {
    "limits with an underscore": (f"{DOWN} --limits elbow_joint=1_0,20", "got elbow_joint=1_0,20"),
    "a file called 7": ("fk ur5e 0 0 0 0 0 0 --limits 7", "'7'"),
    "empty limits": (f"{DOWN} --limits ''", "--limits is empty, expected NAME=LOWER,UPPER|FILE"),
    "a list without words": (f"{DOWN} --free ' '", "--free is empty, expected AXES"),
    "an option twice": (f"{DOWN} --at 0.4 0.2 0.4", "--at is given twice, expected once"),
    "a long name": (f"solve {'a' * 10_000} {REACHABLE}", "unknown"),
    "a size of many digits": (f"export ur5e --to c --ram {'1' * 5000}k", "--ram: '1111"),
    "words twice": (f"{DOWN} --free rz --free x", "--free is given twice"),
    "no such command": ("frob", "frob"),
    "misspelt command": ("slove ur5e", "did you mean 'solve'"),
    "no arm": ("solve", "ARM"),
    "unknown robot": ("show pandda", "did you mean 'panda'"),
    "upper case": ("show UR5E", "did you mean 'ur5e'?"),
    "other case": ("show Panda", "did you mean 'panda'?"),
    "missing file": ("show nowhere.urdf", "nowhere.urdf"),
    "unknown link": ("show panda --tip hand", "unknown link 'hand'"),
    "no such option": ("show panda --frob 1", "--frob"),
    "fk: too few": ("fk panda 1 2", "needs 7 numbers, got 2"),
    "fk: a word": ("fk planar2 1 x", "'x' is not a number"),
    "fk: NaN": ("fk planar2 1 nan", "NaN"),
    "no position": ("solve planar2 --position-only", "--at"),
    "no rotation": (f"solve planar2 {REACHABLE}", "exactly one of --rpy"),
    "two rotations": (f"{PLANAR} --rpy 0 0 0", "--rpy and"),
    "two numbers": ("solve planar2 --at 0.3 0.4 --position-only", "needs 3 numbers, got 2"),
    "four numbers": (f"solve planar2 {REACHABLE} 7 --position-only", "needs 3 numbers, got 4"),
    "digits of another script": (
        "solve planar2 --at \u0660.\u0664 0.2 0 --position-only",
        "'\u0660.\u0664' is not a number",
    ),
    "a word": ("solve planar2 --at 0.3 up 0 --position-only", "'up' is not a number"),
    "NaN": ("solve planar2 --at nan 0 0 --position-only", "NaN"),
    "zero quaternion": (f"solve planar2 {REACHABLE} --quat-wxyz 0 0 0 0", "zero quaternion"),
    "near": (f"{PLANAR} --near 1", "needs 2 numbers, got 1"),
    "near: half": (f"{PLANAR} --near joint1=1", "--near: no value for joint 'joint2'; given: joint1"),
    "near: unknown": (
        f"{PLANAR} --near joint1=1,joint_2=2",
        "unknown joint 'joint_2'; did you mean 'joint2'",
    ),
    "near: twice": (f"{PLANAR} --near joint1=1 joint1=2", "names the joint 'joint1' twice"),
    "near: no number": (f"{PLANAR} --near joint1=1 joint2=x", "--near joint2: 'x' is not a number"),
    "lock: no name": (f"{PLANAR} --lock 1", "takes JOINT=VALUE"),
    "lock: unknown": (f"{PLANAR} --lock elbow=1", "unknown joint 'elbow'"),
    "lock: all": (f"{PLANAR} --lock joint1=1 joint2=1", "locked"),
    "prefer": (f"{PLANAR} --prefer limit", "'limits'"),
    "posture": (f"{UR5E} --prefer elbow=top", "Valid: down, up"),
    "no posture": (f"{UR5E} --prefer elbow=up,x", "got 'x'"),
    "a posture twice": (f"{UR5E} --prefer elbow=up,elbow=up", "names 'elbow' twice"),
    "a posture of all": (f"{UR5E} --all --prefer elbow=up", "cannot be combined with --all"),
    "near and prefer": (f"{PLANAR} --near 1 1 --prefer limits", "--near and --prefer cannot be combined"),
    "count of none": (f"{PLANAR} --all --count 0", "--count"),
    "count alone": (f"{PLANAR} --count 2", "add --all"),
    "all with a search": (
        f"{PLANAR} --all --solver brute-force",
        "cannot be combined with --solver or --trace",
    ),
    "tolerance": (f"{PLANAR} --position-tolerance -1", ">= 0"),
    "unknown search": (f"{PLANAR} --solver brut-force", "did you mean 'brute-force'"),
    "option of another search": (
        f"{PLANAR} --solver brute-force --divisions 3",
        "Its options: --branching-factor",
    ),
    "no search": (f"{PLANAR} --divisions 3", "--divisions needs --solver divide-and-conquer"),
    "no number": (f"{PLANAR} --solver divide-and-conquer --divisions x", "--divisions takes N, got 'x'"),
    "range": (f"{PLANAR} --solver divide-and-conquer --divisions 1", "at least 2"),
    "breadths": (f"{PLANAR} --solver divide-and-conquer --breadth 1,2,3", "got 3"),
    "memory": (
        f"{PLANAR} --solver divide-and-conquer --tree static --branching-factor {'9' * 15}",
        "this machine has",
    ),
}


@pytest.mark.parametrize(("line", "said"), MISUSE.values(), ids=MISUSE)
def test_misuse_is_one_line_and_exit_code_2(cli: CommandLine, line: str, said: str) -> None:
    assert said in cli.refused(line)


def test_without_the_extra_it_says_how_to_install_it(
    cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delitem(sys.modules, "kinseek.cli.program", raising=False)
    monkeypatch.setitem(sys.modules, "click", None)
    assert "pip install 'kinseek[cli]'" in cli.refused("robots")


def test_gather_leaves_other_words_alone() -> None:
    words = ["solve", "--at", "-1", "2", "-3e-1", "panda", "--near", "0", "-1", "--json"]
    assert join_lists(words) == ["solve", "--at=-1 2 -3e-1", "panda", "--near=0 -1", "--json"]
