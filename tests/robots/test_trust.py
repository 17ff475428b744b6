"""Files that may be anybody's: nothing in them is run, and what real descriptions ask for is computed all the same."""

from __future__ import annotations

import contextlib
import math
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import kinseek
from kinseek import InvalidRobot
from kinseek.robots import xacro_untrusted
from kinseek.robots.expressions import FUNCTIONS, Refused, evaluate
from kinseek.robots.yaml_files import yaml_content
from places import SHARED
from robot_files import XACRO, joint, link, write

JOINT = link("a") + link("b") + joint(inside='<axis xyz="0 0 1"/><limit lower="0" upper="{}"/>')


def upper_of(folder: Path, text: str, before: str = "", **options: Any) -> float:
    """Upper limit of an arm whose file has an expression there."""
    path = write(folder, "r.xacro", XACRO.format(before + JOINT.format(text)))
    return float(kinseek.load(path, **options).upper[0])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("${pi/2}", math.pi / 2),
        ("${radians(90) + 2**-1}", math.radians(90) + 0.5),
        ("${math.sqrt(4) if not False and 1 &lt; 2 &lt;= 2 else x}", 2.0),
        ("${min([3, 1, 2]) + len('ab') + (1, 2)[1]}", 5.0),
        ("${'a' + 'b' == 'ab' and 1.5 or 2}", 1.5),
        ("$(eval 1 + more)", 3.0),
        ("$(optenv HOME 0.5)", 0.5),
        ("${yaml['deep'][0].limit}", 1.25),
        ("${2 * yaml.deep[0]['limit']}", 2.5),
    ],
)
def test_what_real_files_ask_for_is_computed(text: str, value: float, tmp_path: Path) -> None:
    (tmp_path / "limits.yaml").write_text("deep:\n  - {limit: 1.25}\n", encoding="utf-8")
    before = '<xacro:arg name="more" default="2"/><xacro:property name="yaml" '
    before += "value=\"${xacro.load_yaml('limits.yaml')}\"/>"
    assert upper_of(tmp_path, text, before, trusted=False) == pytest.approx(value, rel=1e-15)


ESCAPES = [
    "${().__class__.__base__.__subclasses__()}",
    "${[c for c in ().__class__.__base__.__subclasses__()]}",
    "${(lambda: __import__('os'))()}",
    "${'{0.__class__}'.format(1)}",
    "${python.type(1)}",
    "${python.vars()}",
    "${list(map(str, [1]))}",
    "${xacro.tokenize('a')}",
    "${sin.__self__}",
    "${sin}",
    "${'x' * 10**9}",
    "${9**9**9}",
    "${f'{1}'}",
    "${1 if (x := 2) else 0}",
    "${[0] * 10**9}",
    "${1 &lt;&lt; 10**9}",
    "${open('/etc/hostname')}",
    "${max(1, key=str)}",
    "$(eval [c for c in [1]])",
    "$(eval open('/etc/hostname').read())",
    "$(env HOME)",
    "${" + "(" * 300 + "1" + ")" * 300 + "}",
    "${" + "1+" * 6000 + "1}",
]


@pytest.mark.parametrize("text", ESCAPES)
def test_what_is_no_plain_sum_is_refused(text: str, tmp_path: Path) -> None:
    with pytest.raises(InvalidRobot) as told:
        upper_of(tmp_path, text, trusted=False)
    assert str(tmp_path / "r.xacro") in str(told.value)
    assert len(str(told.value)) < 2000


def test_a_file_that_would_run_something_does_not_unless_it_is_trusted(tmp_path: Path) -> None:
    place = tmp_path / "made"
    # A well-known way around what xacro keeps out: code within code is not looked at.
    inner = "list(c for c in [].__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close')"
    text = f"${{list({inner}[0].__init__.__globals__['mkdir']('{place}') or 1.0 for _ in [1])[0]}}"
    with pytest.raises(InvalidRobot, match=r"not trusted.*trusted=True"):
        upper_of(tmp_path, text, trusted=False)
    assert not place.exists()
    upper_of(tmp_path, text)
    assert place.is_dir(), "the test shows nothing: Python did not run it either"


def test_yaml_that_grows_when_written_is_refused(tmp_path: Path) -> None:
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)]
    (tmp_path / "many.yaml").write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(InvalidRobot, match="entries of a YAML file"):
        upper_of(tmp_path, "${xacro.load_yaml('many.yaml')['a8']}", trusted=False)


MAPS = "a0: &a0 {x: 1, y: 2}\n" + "\n".join(
    f"a{i}: &a{i}\n  <<: [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 9)
)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (MAPS, "100,001 entries of a YAML file"),
        ("a: &a [*a]", "100,001 entries of a YAML file"),
        ("a: &a {<<: *a}", "100,001 entries of a YAML file"),
        (f"a: &a {'x' * 9000}\nb: [{'*a, ' * 1000}]", "100,001 entries of a YAML file"),
        ("a: 1" + ":1" * 400, "801 digits of one number"),
        (f"a: !!int {'1' * 401}", "401 digits of one number"),
        ("a: [" + "1, " * 70_000 + "]", "too much to do, at last with YAML files"),
        (f"- {'[' * 450 + '1,' * 280 + ']' * 450}\n" * 100, "33 brackets around one value"),
        (f"- {'{' * 33 + '}' * 33}", "33 brackets around one value"),
    ],
)
def test_yaml_that_takes_long_is_refused(content: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "many.yaml").write_text(content, encoding="utf-8")
    begin = time.process_time()
    with pytest.raises(InvalidRobot, match=message):
        upper_of(tmp_path, "${len(xacro.load_yaml('many.yaml'))}", trusted=False)
    assert time.process_time() - begin < 2


def test_yaml_is_read_as_by_xacro(tmp_path: Path) -> None:
    (tmp_path / "a.yaml").write_text(
        "base: &base {upper: !degrees 90, name: a}\nj: {<<: *base, name: b}\nlist: [0x10, 1:30, .5, yes]\n",
        encoding="utf-8",
    )
    for text in (
        "${xacro.load_yaml('a.yaml')['j']['upper']}",
        "${load_yaml('a.yaml').list[1] / 100 + load_yaml('a.yaml').list[0] / 100}",
        "${1 if load_yaml('a.yaml')['j'].name == 'b' and load_yaml('a.yaml').list[3] else 2}",
        "${len(str(load_yaml('a.yaml'))) / 100}",
    ):
        assert upper_of(tmp_path, text) == upper_of(tmp_path, text, trusted=False)
    with pytest.raises(InvalidRobot, match="there is no key 'k'"):
        upper_of(tmp_path, "${xacro.load_yaml('a.yaml')['j']['k']}", trusted=False)


def test_a_yaml_file_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "a.yaml").write_text("upper: 0.125\n", encoding="utf-8")
    calls, read = [], yaml_content

    def content(*given: Any) -> Any:
        calls.append(given)
        return read(*given)

    monkeypatch.setattr(xacro_untrusted, "yaml_content", content)
    text = "${" + " + ".join(["load_yaml('a.yaml').upper"] * 20) + "}"
    assert upper_of(tmp_path, text, trusted=False) == 2.5
    assert len(calls) == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    "text",
    [
        "[" + ", ".join(["len(big)"] * 100) + "][0]",
        " == ".join(["big"] * 100),
        "[" + ", ".join(["text in text"] * 100) + "][0]",
        "[" + ", ".join(["[big, 1][0][0]"] * 100) + "][0]",
    ],
)
def test_an_expression_that_goes_through_long_values_counts(text: str) -> None:
    spent: list[int] = []
    evaluate(text, {"big": [0.5] * 5000, "text": "a" * 5000}, None, spent.append)
    assert sum(spent) > 2**18


def test_an_expression_holds_no_control_characters() -> None:
    """Python shows a piece of it where it warns, with what would change the terminal."""
    with pytest.raises(Refused, match="control character"):
        evaluate("'\\\x1b'", {})
    assert evaluate("1\t+ 1", {}) == 2


def test_xacro_is_as_it_was_afterwards(tmp_path: Path) -> None:
    with pytest.raises(InvalidRobot):
        upper_of(tmp_path, "${[x for x in [1]]}", trusted=False)
    assert upper_of(tmp_path, "${[x for x in [1]][0]}") == 1.0
    os.environ["KINSEEK_TEST_LIMIT"] = "0.75"
    assert upper_of(tmp_path, "$(env KINSEEK_TEST_LIMIT)") == 0.75


def test_a_real_file_reads_the_same_without_python() -> None:
    paths = sorted(SHARED.rglob("*.xacro"))
    if not paths:
        pytest.skip("no real xacro files here")
    for path in paths:
        options: dict[str, Any] = {"tip": "wx250s/ee_gripper_link"} if "wx250s" in str(path) else {}
        trusted, computed = (kinseek.load(path, trusted=trust, **options) for trust in (True, False))
        np.testing.assert_array_equal(trusted.upper, computed.upper)
        np.testing.assert_array_equal(trusted.fk(trusted.lower), computed.fk(computed.lower))


NUMBERS = st.integers(-9, 9) | st.floats(-9, 9, allow_nan=False)
SUMS = st.recursive(
    NUMBERS.map(repr),
    lambda inner: st.one_of(
        st.tuples(inner, st.sampled_from(["+", "-", "*", "/", "//", "%", "<", "==", "and", "or"]), inner).map(
            lambda parts: "(" + " ".join(parts) + ")"
        ),
        inner.map(lambda text: f"(-{text})"),
        st.tuples(st.sampled_from(["abs", "cos", "float", "bool"]), inner).map(lambda p: f"{p[0]}({p[1]})"),
        st.tuples(inner, inner, inner).map(lambda p: f"({p[0]} if {p[1]} else {p[2]})"),
    ),
    max_leaves=12,
)


@given(SUMS)
def test_sums_are_what_python_makes_of_them(text: str) -> None:
    def outcome(call: Any) -> Any:
        try:
            return repr(call())
        except (ArithmeticError, TypeError, ValueError) as error:
            return type(error)

    ours = outcome(lambda: evaluate(text, {}))
    assert ours == outcome(lambda: eval(text, {"__builtins__": {}}, dict(FUNCTIONS)))


KNOWN = (Refused, SyntaxError, NameError, ArithmeticError, TypeError, ValueError, LookupError)


@pytest.mark.slow
@given(st.text(max_size=60))
def test_any_text_ends_in_a_value_or_in_an_error_that_is_known(text: str) -> None:
    with contextlib.suppress(*KNOWN):
        evaluate(text, {})


@pytest.mark.parametrize("digits", ["-30000000", "30000000", "-10**12"])
def test_rounding_to_millions_of_digits_is_refused(digits: str) -> None:
    with pytest.raises(Refused, match="expected at most 400"):
        evaluate(f"round(1, {digits})", {})
    assert evaluate("round(1234, -2)", {}) == 1200


def test_lists_within_lists_are_counted() -> None:
    def nested(depth: int) -> Any:
        value: Any = [1, 1]
        for _ in range(depth):
            value = evaluate("[p, p]", {"p": value})
        return value

    assert len(nested(10)) == 2
    with pytest.raises(Refused, match="more than 100,000 entries"):
        nested(40)  # Without a limit it has 2^41 entries.


@pytest.mark.parametrize("trusted", ["no", "False", 0, None])
def test_trust_is_true_or_false(trusted: Any, tmp_path: Path) -> None:
    """A word that means no was taken for trust."""
    (tmp_path / "arm.xacro").write_text("<robot/>")
    with pytest.raises(kinseek.InvalidRobot, match="trusted must be True or False, got"):
        kinseek.load(tmp_path / "arm.xacro", trusted=trusted)
    pytest.importorskip("coal")
    pytest.importorskip("pinocchio")
    arm = kinseek.load("planar2")
    with pytest.raises(kinseek.InvalidScene, match="trusted must be True or False, got"):
        kinseek.Scene.of(arm, capsules=0.02, trusted=trusted)
    scene = kinseek.Scene.of(arm, capsules=0.02)
    with pytest.raises(kinseek.InvalidScene, match="trusted must be True or False, got"):
        scene.add_file(tmp_path / "arm.xacro", trusted=trusted)
