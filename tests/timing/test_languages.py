"""Programs of controllers: golden files, numbers, names that could be code, arms that a language cannot hold."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import kinseek
from kinseek.timing.formats import ENDINGS, LANGUAGES, save
from kinseek.timing.languages import KRL, SERVOJ, Language
from stand_in import HOSTILE, arm_with, smooth

COMMENTS = {".script": "#", ".src": ";", ".mod": "!"}
PROGRAMS = [
    ("seam.script", "servoj", 0.5),
    ("seam.script", "movej", None),
    ("seam.script", "movel", None),
    ("seam.src", "krl", 0.5),
    ("seam.mod", "rapid", 0.5),
]


def test_every_language_and_ending_is_tested() -> None:
    assert {language for _, language, _ in PROGRAMS} == set(LANGUAGES)
    assert {Path(file).suffix for file, *_ in PROGRAMS} == set(ENDINGS) == set(COMMENTS)


def written(folder: Path, file: str, trajectory: Any, *args: Any, **options: Any) -> str:
    save(trajectory, folder / file, *args, **options)
    return (folder / file).read_bytes().decode("ascii")


def points(text: str) -> np.ndarray:
    """The joint values of all points of a program, in [rad] and [m]."""
    rows = []
    for line in text.splitlines():
        if "servoj([" in line or "movej([" in line or "movel([" in line:
            rows.append([float(word) for word in line.split("[")[1].split("]")[0].split(",")])
        elif "PTP {" in line:
            values = dict(word.split() for word in line.split("{")[1].split("}")[0].split(","))
            rows.append(
                [np.deg2rad(float(v)) if k.startswith("A") else float(v) / 1e3 for k, v in values.items()]
            )
        elif "MoveAbsJ" in line:
            own, external = re.findall(r"\[([^\[\]]+)\]", line)
            further = [float(v) / 1e3 for v in external.split(",") if "9E9" not in v]
            rows.append([*np.deg2rad([float(v) for v in own.split(",")]), *further])
    return np.array(rows)


@pytest.mark.parametrize(("file", "language", "period"), PROGRAMS)
def test_golden_programs(file: str, language: str, period: float | None, tmp_path: Path) -> None:
    text = written(tmp_path, file, smooth(), period, language=language)
    golden = Path(__file__).parent / "golden" / f"{language}{Path(file).suffix}"
    assert text.replace("\r\n", "\n") == golden.read_text(encoding="ascii")
    ends = "\r\n" if language in ("krl", "rapid") else "\n"
    assert text.count("\n") == text.count(ends)
    assert text.count("\r") == text.count("\r\n")


@pytest.mark.parametrize(("file", "language", "period"), PROGRAMS)
def test_numbers_are_read_back(file: str, language: str, period: float | None, tmp_path: Path) -> None:
    trajectory = smooth()
    found = points(written(tmp_path, file, trajectory, 0.013, language=language))
    expected = trajectory.sample(0.013).q
    if language == "servoj":  # The last point is held.
        expected = np.append(expected, expected[-1:], axis=0)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() < 1e-11
    assert not re.search(r"-0\.0+\b", (tmp_path / file).read_text())


@pytest.mark.parametrize("file", ["rail.src", "rail.mod"])
def test_a_rail_is_an_external_axis(file: str, tmp_path: Path) -> None:
    trajectory = smooth("ur10e_rail")
    found = points(written(tmp_path, file, trajectory))
    np.testing.assert_allclose(found, np.roll(trajectory.q([0.0, 1.0, 2.0]), -1, axis=1), atol=1e-11)


def test_times_of_a_program_are_those_of_the_motion(tmp_path: Path) -> None:
    trajectory = smooth(pose_times=(0.0, 0.3, 1.1, 2.0))
    src = written(tmp_path, "a1.src", trajectory)
    parts = [float(each) for each in re.findall(r"PART = (\S+)", src)]
    np.testing.assert_allclose(np.cumsum(parts) / 100 * 2.0, [0.3, 1.1, 2.0], atol=1e-8)
    assert "TIME_BLOCK END = 2.000000" in src
    mod = written(tmp_path, "a1.mod", trajectory)
    np.testing.assert_allclose([float(each) for each in re.findall(r"T:=([0-9.]+)", mod)], [0.3, 0.8, 0.9])
    assert re.findall(r"(z0|fine)", mod) == ["fine", "z0", "z0", "fine"]


def test_the_last_move_is_not_too_short(tmp_path: Path) -> None:
    for duration, last in ((2.04, 0.14), (2.06, 0.06), (2.0, 0.1), (0.02, 0.02)):
        text = written(tmp_path, "seam.mod", smooth(duration=duration), 0.1)
        times = [float(each) for each in re.findall(r"T:=([0-9.]+)", text)]
        assert times[-1] == pytest.approx(last)
        assert sum(times) == pytest.approx(duration)


def test_no_step_of_a_stream_is_longer_than_a_period(tmp_path: Path) -> None:
    """The last but one was left out if it was near the end: the last step was up to half as fast again."""
    trajectory = smooth(duration=2.04)
    found = points(written(tmp_path, "seam.script", trajectory, 0.1))
    np.testing.assert_allclose(found[[0, 19, 20, 21]], trajectory.q([0.0, 1.9, 2.0, 2.04]), atol=1e-9)
    times = re.findall(r"\], 0, 0, ([0-9.]+),", (tmp_path / "seam.script").read_text())
    assert set(times[:-1]) == {"0.100000"}  # Also the last step.


@pytest.mark.parametrize(("file", "language", "period"), PROGRAMS)
def test_names_from_files_never_become_code(
    file: str, language: str, period: float | None, tmp_path: Path
) -> None:
    plain, hostile = (
        written(tmp_path, file, smooth(arm_with(names)), period, language=language)
        for names in ("uvwxyz", HOSTILE)
    )
    comment = COMMENTS[Path(file).suffix]

    def code(text: str) -> list[str]:
        return [line for line in text.splitlines() if not line.strip().startswith(comment)]

    assert code(hostile) == code(plain)
    assert hostile.count("\n") == plain.count("\n")
    assert set(hostile) <= {"\r", "\n", *map(chr, range(32, 127))}
    assert max(map(len, hostile.splitlines())) < 250


@pytest.mark.parametrize(
    "name",
    [
        "",
        "9a",
        "a b",
        "a-b",
        'a"',
        "a()\nHALT\n",
        "a\n",
        "ä",
        "a;b",
        "{0}",
        "a" * 100,
        "END",
        "movej",
        "tool0",
    ],
)
def test_a_program_has_a_name_that_is_an_identifier(name: str, tmp_path: Path) -> None:
    file = "movej.script" if name == "movej" else "tool0.mod" if name == "tool0" else "seam.src"
    given = None if file.startswith(name or "?") else name
    with pytest.raises(kinseek.InvalidProblem, match="cannot be called") as error:
        save(smooth(), tmp_path / file, 0.5, name=given)
    assert "\n" not in str(error.value)
    assert list(tmp_path.iterdir()) == []
    assert "DEF welding()" in written(tmp_path, "2-seams.src", smooth(), name="welding")


@pytest.mark.parametrize("name", ["while.script", "True.script", "LOOP.src", "if.src", "var.mod", "IF.mod"])
def test_words_of_a_language_are_no_names_of_programs(name: str, tmp_path: Path) -> None:
    with pytest.raises(kinseek.InvalidProblem, match="which is a word of its language"):
        save(smooth(), tmp_path / name, 0.5)


@pytest.mark.parametrize(
    ("arm", "file", "said"),
    [
        (
            "panda",
            "seam.script",
            "exactly 6 axes that turn.*panda_joint7 .revolute.: there are too many joints",
        ),
        ("m430ia2f", "seam.script", "exactly 6 axes.*no joint is left for J6"),
        ("ur10e_rail", "seam.script", "rail_joint .prismatic.*too many"),
        ("panda", "seam.src", "at most 6 axes and 6 external ones.*too many"),
        ("panda", "seam.mod", "at most 6 axes and 6 external ones.*too many"),
        ("scara4", "seam.mod", "a prismatic joint is between others"),
    ],
)
def test_an_arm_that_a_language_cannot_hold(arm: str, file: str, said: str, tmp_path: Path) -> None:
    with pytest.raises(kinseek.InvalidProblem, match=said):
        save(smooth(arm), tmp_path / file, 0.5)
    assert list(tmp_path.iterdir()) == []


def test_a_black_box_has_no_units(tmp_path: Path) -> None:
    arm = kinseek.Arm.from_fk(lambda q: np.eye(4), [0.0] * 6, [1.0] * 6, vectorized=False)
    with pytest.raises(kinseek.InvalidProblem, match=r"joints with a unit.*number"):
        save(smooth(arm), tmp_path / "seam.script", 0.5)


def test_the_axis_of_each_joint_can_be_given(tmp_path: Path) -> None:
    scara = smooth("scara4")
    names = scara.mechanism.joint_names
    axes = dict(zip(names, ("A1", "A2", "A3", "A6"), strict=True))
    src = written(tmp_path, "seam.src", scara, axes=axes)
    slides = np.array([kind == "prismatic" for kind in scara.mechanism.kinds])
    values = scara.q(2.0) * np.where(slides, 1e3, np.rad2deg(1.0))
    last = ", ".join(f"{axis} {value:.9f}" for axis, value in zip(axes.values(), values, strict=True))
    assert f"SPTP {{{last}}}" in src
    turned = smooth("ur5e")
    six = dict(zip(turned.mechanism.joint_names, ("J6", "J5", "J4", "J3", "J2", "J1"), strict=True))
    found = points(written(tmp_path, "seam.script", turned, 0.5, axes=six))
    np.testing.assert_allclose(found[0], turned.q(0.0)[::-1], atol=1e-12)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"elbow_joint": "A9"}, "axes: unknown axis 'A9'.*Valid: A1"),
        ({"elbow": "A3"}, "axes: unknown joint 'elbow'; did you mean 'elbow_joint'"),
        ({"elbow_joint": "A1"}, "the same axis for two joints"),
        ({"elbow_joint": None}, "no axis for the joints elbow_joint"),
    ],
)
def test_wrong_axes(change: dict[str, Any], said: str, tmp_path: Path) -> None:
    trajectory = smooth("ur5e")
    axes = dict(zip(trajectory.mechanism.joint_names, KRL.axes, strict=True)) | change
    axes = {joint: axis for joint, axis in axes.items() if axis is not None}
    with pytest.raises(kinseek.InvalidProblem, match=said):
        save(trajectory, tmp_path / "seam.src", axes=axes)


def test_a_prismatic_joint_is_no_axis_of_urscript(tmp_path: Path) -> None:
    rows = [(0.1, 0.2, 1.0, 0.0)] * 6
    arm = kinseek.Arm.from_dh(rows, [-1.0] * 6, [1.0] * 6, kinds="RRRRRP", names=list("uvwxyz"))
    axes = dict(zip("uvwxyz", ("J1", "J2", "J3", "J4", "J5", "J6"), strict=True))
    with pytest.raises(kinseek.InvalidProblem, match="J6 would be prismatic"):
        save(smooth(arm), tmp_path / "seam.script", 0.5, axes=axes)
    fewer = replace(SERVOJ, axes=(*SERVOJ.axes, "J7"), unused_axis="0")
    with pytest.raises(kinseek.InvalidProblem, match="J6 would be prismatic"):
        save(smooth(arm), tmp_path / "seam.script", 0.5, axes=axes, language=fewer)


def test_moves_of_a_program_keep_the_limits(tmp_path: Path) -> None:
    """On a straight way all joints move in proportion, so each has its part of the speed of the one that moves farthest."""
    rng = np.random.default_rng(4)
    for _ in range(20):
        trajectory = smooth()
        trajectory.end = trajectory.start + rng.uniform(-1, 1, 6) * 10.0 ** rng.uniform(-3, 0, 6)
        trajectory.limits.acceleration = rng.uniform(1.0, 8.0, 6)
        trajectory.pose_times = np.sort(np.append(rng.uniform(0, 2.0, 5), [0.0, 2.0]))
        text = written(tmp_path, "seam.script", trajectory, language="movej", blend=0.05)
        moves = re.findall(r"a=([0-9.]+), v=([0-9.]+), r=([0-9.]+)", text)
        acceleration, velocity, radius = np.array(moves, dtype=float).T
        steps = np.abs(np.diff(trajectory.q(trajectory.pose_times), axis=0))
        parts = steps / steps.max(axis=1, keepdims=True)
        assert (parts * acceleration[:, None] < trajectory.limits.acceleration + 1e-5).all()
        peak = np.abs(trajectory.velocity(np.linspace(0, 2, 1000))).max(axis=0)
        slow = velocity < 0.0011  # The least speed.
        assert (parts * velocity[:, None] < peak + 1e-5)[~slow].all()
        places = trajectory.mechanism.forward(trajectory.q(trajectory.pose_times))[:, :3, 3]
        distances = np.linalg.norm(np.diff(places, axis=0), axis=1)
        assert radius[-1] == 0.0
        assert (radius[:-1] + radius[1:] <= distances[1:] + 1e-12).all()
        assert (radius <= distances).all()
        assert radius.max() <= 0.05


def test_blends_are_measured_at_the_tool(tmp_path: Path) -> None:
    """A tool far from the tip moves farther, so a blend around it may be larger."""
    tool = np.eye(4)
    tool[:3, 3] = [0.0, 0.3, 0.4]
    largest = []
    for trajectory in (smooth(), smooth(tool=tool)):
        text = written(tmp_path, "seam.script", trajectory, 0.5, language="movel", blend=10.0)
        largest.append(max(float(each) for each in re.findall(r"r=([0-9.]+)", text)))
        q = trajectory.sample(0.5).q
        poses = trajectory.mechanism.forward(q) @ (np.eye(4) if trajectory.tool is None else tool)
        distances = np.linalg.norm(np.diff(poses[:, :3, 3], axis=0), axis=1)
        assert largest[-1] == pytest.approx(np.minimum(distances[:-1], distances[1:]).max() / 2, abs=1.1e-6)
    assert largest[0] < largest[1]


def test_a_joint_without_a_limit_has_the_default_acceleration(tmp_path: Path) -> None:
    trajectory = smooth()
    trajectory.limits.acceleration[:] = np.inf
    assert "a=1.400000, v=" in written(tmp_path, "seam.script", trajectory, language="movej")


def test_a_motion_without_a_way(tmp_path: Path) -> None:
    trajectory = smooth()
    trajectory.end = trajectory.start.copy()
    for language in LANGUAGES:
        text = written(tmp_path, "seam.txt", trajectory, 0.5, language=language)
        assert "nan" not in text
        assert "inf" not in text
    trajectory.duration, trajectory.pose_times = 0.0, np.zeros(1)
    with pytest.raises(kinseek.InvalidProblem, match="takes no time"):
        save(trajectory, tmp_path / "seam.src")


def test_a_language_of_ones_own(tmp_path: Path) -> None:
    own = Language(
        axes=("a", "b", "c", "d", "e", "f"),
        header="(PROGRAM {name}, {count} POINTS)\n{comments}\nJ {axes}\n",
        line="J {axes} T{duration:.3f} N{number} V{velocity:.3f}\n",
        footer="END {total:.1f}\n",
        axis="{name}{value}",
        comment="//",
        degrees=True,
        decimals=3,
    )
    lines = written(tmp_path, "seam.nc", smooth(), language=own).splitlines()
    assert lines[0] == "(PROGRAM seam, 3 POINTS)"
    assert lines[1] == "// kinseek: ur5e, 3 points, 2 s"
    assert lines[-2:] == [
        "J a-8.594, b-31.513, c2.865, d-20.054, e14.324, f-8.594 T1.000 N2 V7.162",
        "END 2.0",
    ]
    for text, said in (
        ("{axs}", "unknown field 'axs'; did you mean 'axes'"),
        ("{", "braces are doubled"),
        ("{}", "braces"),
    ):
        wrong = Language(axes=own.axes, header="", line=text, footer="", comment="//")
        with pytest.raises(kinseek.InvalidUse, match=said):
            save(smooth(), tmp_path / "seam2.nc", language=wrong)
    with pytest.raises(kinseek.InvalidUse, match="unknown field 'number'"):
        save(smooth(), tmp_path / "seam2.nc", language=replace(own, axis="{number}"))
    assert not (tmp_path / "seam2.nc").exists()
    save(smooth(), tmp_path / "seam2.nc", language=replace(own, footer="Schluß"))
    assert (tmp_path / "seam2.nc").read_text(encoding="utf-8").endswith("Schluß")
