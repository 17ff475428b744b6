"""``kinseek check``: one finding for every fault that is planted, none in sound files."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import pytest

import kinseek
from bad_urdf import BAD_FILES
from command_line import CommandLine
from kinseek.robots import catalog_names, read_urdf, soundness
from kinseek.robots.checks import CHECKS, Refuses, Severity, findings
from kinseek.robots.packages import mesh_path
from kinseek.robots.soundness import Finding, check
from kinseek.robots.urdf_file import Robot
from kinseek.robots.xml_files import root_element
from places import SHARED
from robot_files import XACRO, joint, robot, write

INERTIAL = (
    '<inertial><mass value="2"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial>'
)
SOUND = f"""<robot name="r">
<link name="a">{INERTIAL}</link><link name="b">{INERTIAL}</link><link name="c">{INERTIAL}</link>
<joint name="one" type="revolute"><origin xyz="0 0 1" rpy="0 0 0"/><parent link="a"/><child link="b"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="2" effort="1" velocity="1"/></joint>
<joint name="two" type="revolute"><origin xyz="1 0 0" rpy="0 0 0"/><parent link="b"/><child link="c"/>
<axis xyz="0 1 0"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>
</robot>"""
LIMIT = '<limit lower="-1" upper="2" effort="1" velocity="1"/>'
SOFT = '<safety_controller k_velocity="9" soft_lower_limit="{}" soft_upper_limit="{}"/>'
MESH = '<link name="c"><visual><geometry><mesh filename="{}"/></geometry></visual>'
JOINT_FAULTS = {
    "reversed": ('lower="-1"', 'lower="3"', "error", "lower limit 3.0 is above upper limit 2.0"),
    "stuck": ('lower="-1"', 'lower="2"', "warning", "cannot move"),
    "degrees": ('lower="-1" upper="2"', 'lower="-180" upper="180"', "warning", "degrees?"),
    "nearly a turn": (
        'lower="-1" upper="2"',
        'lower="-3.14159" upper="3.14159"',
        "note",
        "limits [-3.14159, 3.14159] are 5.3e-06 rad short of a full turn",
    ),
    "negative": (
        'velocity="1"/></joint>\n<joint',
        'velocity="-1"/></joint>\n<joint',
        "warning",
        "velocity limit -1",
    ),
    "no axis": ('<axis xyz="0 0 1"/>', "", "note", "the default of URDF is used"),
    "rpy in degrees": ('rpy="0 0 0"', 'rpy="0 0 90"', "warning", "more than a full turn"),
    "millimetres": ('xyz="0 0 1" rpy', 'xyz="0 0 333" rpy', "warning", "millimetres?"),
    "floating": (
        'type="revolute"',
        'type="floating"',
        "warning",
        "is floating: between base and tip it needs",
    ),
    "continuous": ('type="revolute"', 'type="continuous"', "note", "its limits in <limit> are ignored"),
    "soft limits": (LIMIT, f"{LIMIT}{SOFT.format('-2', '1')}", "note", "narrow [-1, 2] to [-1, 1]"),
    "soft limits of 0": (LIMIT, f"{LIMIT}{SOFT.format('0.0', '0')}", "note", "as if they were missing"),
    "stuck softly": (LIMIT, f"{LIMIT}{SOFT.format('2', '3')}", "warning", "cannot move: its soft limits"),
    "soft limits apart": (LIMIT, f"{LIMIT}{SOFT.format('3', '4')}", "error", "leave no value within"),
    "no soft number": (LIMIT, f"{LIMIT}{SOFT.format('a', '4')}", "error", "soft_lower_limit='a': 'a' is no"),
    "two controllers": (
        LIMIT,
        f"{LIMIT}{SOFT.format('-1', '1') * 2}",
        "error",
        "2 <safety_controller> elements",
    ),
    "soft and continuous": (
        f'"revolute"><origin xyz="0 0 1" rpy="0 0 0"/><parent link="a"/><child link="b"/>\n<axis xyz="0 0 1"/>{LIMIT}',
        f'"continuous"><parent link="a"/><child link="b"/>{SOFT.format("-1", "1")}',
        "note",
        "its limits in <safety_controller> are ignored",
    ),
    "slide": ('lower="-1" upper="2"', 'lower="0" upper="500"', "warning", "millimetres?"),
    "mimics nobody": (LIMIT, '<mimic joint="tow"/>', "error", "unknown joint 'tow'; did you mean 'two'"),
    "mimics with 0": (LIMIT, '<mimic joint="two" multiplier="0"/>', "warning", "does not move"),
    "reversed for nothing": (
        LIMIT,
        '<limit lower="2" upper="-1"/><mimic joint="two"/>',
        "warning",
        "its limits are ignored: lower limit 2.0 is above upper limit -1.0",
    ),
}
"""Of joint 'one': what is replaced, by what, how severe that is, and what is said."""
LINK_FAULTS = {
    "mass of no number": (
        '<mass value="2"/>',
        '<mass value="x"/>',
        "warning",
        "<mass> value='x': 'x' is not a number",
    ),
    "massless": ('<mass value="2"/>', '<mass value="0"/>', "warning", "mass 0 kg"),
    "no mass": ('<mass value="2"/>', "", "warning", "has no mass"),
    "no inertia": ('izz="0.1"', "", "warning", "inertia has no izz"),
    "zero inertia": ('izz="0.1"', 'izz="0"', "warning", "least principal moment is 0"),
    "no body's": ('izz="0.1"', 'izz="0.3"', "warning", "0.3 > 0.1 + 0.1"),
    "negative inertia": ('ixy="0"', 'ixy="0.2"', "warning", "least principal moment is -0.1"),
}
"""The same of link 'a'."""
FAULTS = {
    **{fault: (*row, "joint 'one'") for fault, row in JOINT_FAULTS.items()},
    **{fault: (*row, "link 'a'") for fault, row in LINK_FAULTS.items()},
    "a note on the same joint": (
        f'<axis xyz="0 0 1"/>{LIMIT}',
        '<mimic joint="two" offset="2e7"/>',
        "error",
        "joint 'one' has limits up to 2e+07",
        "",
    ),
    "one without": (
        f'<link name="a">{INERTIAL}</link>',
        '<link name="a"/>',
        "note",
        "1 of 3 links have no mass: a",
        "",
    ),
    "lost mesh": (
        '<link name="c">',
        MESH.format("meshes/c.stl"),
        "warning",
        "not found",
        "mesh 'meshes/c.stl'",
    ),
    "lost package": (
        '<link name="c">',
        MESH.format("package://arm/c.stl"),
        "warning",
        "1 meshes",
        "package 'arm'",
    ),
    "two tips": (
        "</robot>",
        '<link name="d"/><joint name="x" type="fixed"><parent link="b"/><child link="d"/></joint></robot>',
        "note",
        "2 tips: kinseek.load needs tip=, one of c, d",
        "",
    ),
}
"""These, and others with the part that they are found in."""


def checked(folder: Path, text: str) -> list[Finding]:
    """What is found in a file of this text."""
    return check(write(folder, "r.urdf", text)).findings


def test_every_check_is_of_something() -> None:
    """Arms are refused for their joints alone, so such a check is of a joint."""
    assert {check.of for check in CHECKS} == {"robot", "link", "joint"}
    assert {check.of for check in CHECKS if check.refuses is Refuses.ARM} == {"joint"}
    robot = Robot(root_element(SOUND.encode(), "r.urdf"), "r.urdf")
    with pytest.raises(KeyError):
        list(findings(CHECKS[0]._replace(of="links"), robot))  # type: ignore[arg-type]


def test_a_sound_file(tmp_path: Path, cli: CommandLine) -> None:
    path = write(tmp_path, "r.urdf", SOUND)
    assert cli("check", path).out == f"{path} (3 links, 2 joints, 2 of them move): sound\n"


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_every_fault_is_found(fault: str, tmp_path: Path, cli: CommandLine) -> None:
    old, new, severity, what, part = FAULTS[fault]
    text = SOUND.replace(old, new, 1)
    if fault == "slide":
        text = text.replace('type="revolute"', 'type="prismatic"', 1)
    assert text != SOUND
    path, sound = write(tmp_path, "r.urdf", text), severity == "note"
    facts = cli("check", path, "--json", code=0 if sound else 1).facts
    found = [each for each in facts["findings"] if what in each["what"]]
    assert [(each["severity"], each["part"]) for each in found] == [(severity, part)]
    assert facts["sound"] is sound
    said = cli("check", path, code=0 if sound else 1).out
    assert f"{severity}: {part}{': ' if part else ''}{found[0]['what']}" in said


def test_several_faults_are_several_lines_the_worst_first(tmp_path: Path, cli: CommandLine) -> None:
    text = SOUND.replace('<mass value="2"/>', '<mass value="-2"/>', 1).replace('lower="-1.5"', 'lower="5"')
    path = write(tmp_path, "r.urdf", text.replace('<axis xyz="0 0 1"/>', ""))
    said = cli("check", path, code=1).out.splitlines()
    assert [line.partition(":")[0] for line in said[:3]] == ["error", "warning", "note"]
    assert said[3].endswith("not sound, 1 error, 1 warning, 1 note")


@pytest.mark.parametrize("name", ["meshes/c.stl", "package://arm/c%20d.stl", "file://c.stl"])
def test_meshes_that_are_there(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "arm" / "urdf"
    for place in (folder / "meshes" / "c.stl", tmp_path / "arm" / "c d.stl", folder / "c.stl"):
        place.parent.mkdir(parents=True, exist_ok=True)
        place.touch()
    text = SOUND.replace('<link name="c">', MESH.format(name))
    assert checked(folder, text) == []
    if name.startswith("package"):  # A folder beside those above the file, too.
        (tmp_path / "elsewhere").mkdir()
        assert checked(tmp_path / "elsewhere", text) == []
        away = write(tmp_path.parent, f"{tmp_path.name}_away.urdf", text)
        assert [each.severity for each in check(away).findings] == [Severity.WARNING]
        monkeypatch.setenv("ROS_PACKAGE_PATH", os.pathsep.join(["/nowhere", str(tmp_path)]))
        assert check(away).findings == []


@pytest.mark.parametrize(
    "name",
    [
        "package://arm/../secret.stl",
        "package://arm/meshes/../../secret.stl",
        "package://arm/%2e%2e/secret.stl",
        "package://arm/..\\secret.stl",
        "package://arm/{0}/secret.stl",
        "package://arm/%2F{0}/secret.stl",
        "package://arm/C:/secret.stl",
        "package://../secret.stl",
        "package://./secret.stl",
        "package:///secret.stl",
        "package://..\\.\\secret.stl",
        "model://arm/../secret.stl",
    ],
)
def test_addresses_that_lead_out_of_their_package_are_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    (tmp_path / "secret.stl").touch()
    path = tmp_path / "arm" / "r.urdf"
    name = name.format(tmp_path)
    with pytest.raises(kinseek.InvalidRobot, match=r"leads out of its package: got .*, expected"):
        mesh_path(name, path, {"arm": path.parent})
    (finding,) = checked(path.parent, SOUND.replace('<link name="c">', MESH.format(name)))
    assert (finding.severity, "leads out of its package" in finding.what) == (Severity.WARNING, True)


def test_an_address_may_go_up_inside_its_package(tmp_path: Path) -> None:
    (tmp_path / "arm" / "meshes").mkdir(parents=True)
    (tmp_path / "arm" / "c..stl").touch()
    found = mesh_path("package://arm/meshes/.././c..stl", tmp_path / "arm" / "r.urdf", {})
    assert found.samefile(tmp_path / "arm" / "c..stl")


def test_a_tip_of_several_is_looked_at_alone(tmp_path: Path) -> None:
    path = write(tmp_path, "r.urdf", SOUND)
    assert "no movable joint between base 'c' and tip 'c'" in check(path, "c", "c").findings[0].what
    assert check(path, "c", "b").sound
    assert check(path, "b", "c").sound


@pytest.mark.parametrize("name", ["ur5e", "irb5400", "planar2"])
def test_bundled_arms_are_sound(name: str, cli: CommandLine) -> None:
    assert name in catalog_names()
    assert "note: limits: " in cli("check", name).out


@pytest.mark.parametrize("name", ["puma560", "so101"])
def test_limits_that_are_known_to_be_wrong_are_a_warning(name: str, cli: CommandLine) -> None:
    assert "warning: limits: " in cli("check", name, code=1).out


UNREADABLE = {
    "nowhere.urdf": (None, "no file"),
    "broken.urdf": ("<robot", "broken XML"),
    "other.urdf": ("<html/>", "not a robot"),
    "r.txt": ("<robot/>", "expected the path of a .urdf"),
    "UR5E": (None, "did you mean 'ur5e'"),
}


@pytest.mark.parametrize("name", UNREADABLE)
def test_what_cannot_be_read(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    text, said = UNREADABLE[name]
    if text is not None:
        Path(name).write_text(text, encoding="utf-8")
    assert said in cli.refused("check", name)


@pytest.mark.slow
@pytest.mark.skipif(not SHARED.is_dir(), reason="the robots are not here")
def test_real_files(capsys: pytest.CaptureFixture[str]) -> None:
    for path in sorted(SHARED.glob("*.urdf")):
        assert check(path).sound, path
    for name, meshes in (("urdf_meshes_panda/panda.urdf", 20), ("urdf_tree_yumi/yumi.urdf", 20)):
        warnings = [
            each for each in check(SHARED / "messy" / name).findings if each.severity is Severity.WARNING
        ]
        assert [f"{meshes} meshes" in each.what for each in warnings] == [True]
    meshes_elsewhere = SHARED / "messy" / "xacro_wx250s" / "wx250s.urdf.xacro"
    assert not check(meshes_elsewhere).sound


@pytest.mark.slow
def test_a_large_file_takes_seconds(tmp_path: Path) -> None:
    links = " ".join(f"l{i}" for i in range(5001))
    ring = [joint(f"j{i}", f"l{i} l{(i + 1) % 5000}", "fixed", "") for i in range(5000)]
    found = checked(tmp_path, robot(*ring, links=links))
    (loop,) = [each.what for each in found if each.severity is Severity.ERROR]
    assert "form a loop" in loop
    astray = [joint(f"j{i}", f"x{i} y{i}", "fixed", "") for i in range(5000)]
    assert len(checked(tmp_path, robot(*astray, links=links))) > 10_000
    with pytest.raises(kinseek.InvalidRobot, match="10,002 links, expected at most 10,000"):
        checked(tmp_path, robot(links=f"{links} {links}"))


def test_names_are_suggested_for_the_first_unknown_ones_alone(tmp_path: Path) -> None:
    links = " ".join(f"link_{i}" for i in range(300))
    lost = [joint(f"j{i}", f"link_0 lnk_{i}", "fixed", "") for i in range(300)]
    found = checked(tmp_path, robot(*lost, links=links))
    told = [each.what for each in found if "refers to link" in each.what]
    assert len(told) == 300
    assert told[0].startswith("refers to link 'lnk_0', which does not exist; did you mean 'link_0'")
    assert 10 < sum("did you mean" in each for each in told) <= 20


def test_a_joint_without_a_name_is_not_suggested(tmp_path: Path) -> None:
    nameless = SOUND.replace(' name="one"', "")
    found = checked(tmp_path, nameless.replace('upper="1.5"', 'upper="1.5"/><mimic joint="tow"'))
    told = [each.what for each in found]
    assert "a <joint> in line 3 has no name" in told
    assert "mimics unknown joint 'tow'; did you mean 'two'?" in told


@pytest.mark.slow
def test_a_file_is_parsed_once_for_all_its_tips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    parsed: list[str] = []

    class Counted(Robot):
        def __init__(self, root: Any, where: str, packages: Any = None) -> None:
            parsed.append(where)
            super().__init__(root, where, packages)

    monkeypatch.setattr(soundness, "Robot", Counted)
    inside = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/>'
    for count, tried in ((40, 40), (2_000, 19)):
        names = [f"l{i}" for i in range(count)]
        joints = [joint(f"j{i}", f"l {name}", inside=inside) for i, name in enumerate(names)]
        parsed.clear()
        found = checked(tmp_path, robot(*joints, links=f"l {' '.join(names)}"))
        assert parsed == [str(tmp_path / "r.urdf")]
        told = f"only the first {tried} of {count} tips are tried"
        assert (told in [each.what for each in found]) == (tried < count)


@pytest.mark.parametrize("case", BAD_FILES)
def test_what_load_refuses_is_reported(case: str, tmp_path: Path) -> None:
    path = write(tmp_path, "r.urdf", BAD_FILES[case][0])
    with pytest.raises(kinseek.InvalidRobot) as refused:
        read_urdf(path)
    said = str(refused.value).removeprefix(f"{path}: ")
    if said.startswith(("broken XML", "not a robot")):
        with pytest.raises(kinseek.InvalidRobot, match=re.escape(said)):
            check(path)
        return
    found = [each for each in check(path).findings if each.severity is Severity.ERROR]
    sentences = {f"{each.part}{between}{each.what}" for each in found for between in (" ", ": ")}
    sentences |= {each.what for each in found}
    # Whether a leader moves depends on base and tip; the check only tells whether there is one.
    assert said in sentences or "joint 'j' mimics unknown joint 'z'" in sentences


def test_mjcf_is_read(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")

    def found(*bodies: str, limits: str = "-1 1", angle: str = "degree") -> list[tuple[Severity, str]]:
        joints = [
            f"<body name='{name}'><joint name='j{name}' axis='0 0 1' range='{limits}' limited='true'/></body>"
            for name in bodies
        ]
        text = f"<compiler angle='{angle}'/><worldbody>{''.join(joints)}</worldbody>"
        findings = check(write(tmp_path, "r.xml", f"<mujoco>{text}</mujoco>")).findings
        return [(each.severity, each.what.partition(" in rad")[0]) for each in findings]

    assert found("a") == []
    assert [severity for severity, _ in found("a", "b")] == [Severity.NOTE]
    many_turns = (Severity.WARNING, "joints with limits of many turns")
    assert found("a", limits="-180 180", angle="radian") == [many_turns]


def test_a_xacro_file_gets_its_arguments_and_packages(tmp_path: Path, cli: CommandLine) -> None:
    package = tmp_path / "away" / "parts"
    (package / "meshes").mkdir(parents=True)
    (package / "meshes" / "c.stl").touch()
    write(package, "high.xacro", XACRO.format('<xacro:property name="high" value="$(arg high)"/>'))
    head = '<xacro:arg name="high" default="none"/><xacro:include filename="$(find parts)/high.xacro"/>'
    body = SOUND.removeprefix('<robot name="r">').removesuffix("</robot>")
    body = body.replace('lower="-1"', 'lower="-${high}"', 1)
    body = body.replace('<link name="c">', MESH.format("package://parts/meshes/c.stl"))
    (tmp_path / "here").mkdir()
    path = write(tmp_path / "here", "r.xacro", XACRO.format(head + body))
    given = ["--package", f"parts={package}", "--arg high=0.25"]
    cli("check", path, *given)
    assert "-0.250000" in cli("show", path, *given).out
    assert "package 'parts' is not found; say where it is" in cli.refused("show", path)
    for words, said in (
        (["--arg hihg=1", *given[:2]], "did you mean 'high'"),
        (["--arg high"], "--arg takes NAME=VALUE, got 'high'"),
        ([*given, "--arg high=1"], "--arg names 'high' twice"),
    ):
        assert said in cli.refused("show", path, *words)
