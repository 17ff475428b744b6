"""DH tables against the plain product of their four elementary transforms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from kinseek.errors import InvalidRobot
from kinseek.kernels.arm.forward import forward_many
from kinseek.robots import read_dh
from kinseek.robots.chain import Array

PI = np.pi


def turn_x(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[1, 0, 0, 0], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def turn_z(angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])


def slide(x: float = 0.0, z: float = 0.0) -> Array:
    pose = np.eye(4)
    pose[0, 3], pose[2, 3] = x, z
    return pose


NUMBER = st.floats(-3, 3)
ROWS = st.lists(
    st.tuples(st.sampled_from("RP"), st.tuples(*[NUMBER] * 4), NUMBER),
    min_size=1,
    max_size=7,
)


@settings(max_examples=60)
@given(ROWS, st.booleans())
def test_any_table_is_the_product_of_its_rows(
    table: list[tuple[str, tuple[float, ...], float]], standard: bool
) -> None:
    kinds = "".join(kind for kind, _, _ in table)
    base, tool = turn_x(0.3) @ slide(1, 2), slide(0.1, -0.2) @ turn_z(0.4)
    expected = base
    for kind, (a, alpha, d, theta), q in table:
        turned, slid = (theta + q, d) if kind == "R" else (theta, d + q)
        if standard:
            expected = expected @ turn_z(turned) @ slide(z=slid) @ slide(x=a) @ turn_x(alpha)
        else:
            expected = expected @ turn_x(alpha) @ slide(x=a) @ turn_z(turned) @ slide(z=slid)
    chain = read_dh(
        [row for _, row, _ in table],
        [-3] * len(table),
        [3] * len(table),
        convention="standard" if standard else "modified",
        kinds=kinds,
        base=base,
        tool=tool,
    )
    pose = forward_many(chain.arrays, np.array([[q for _, _, q in table]]))[0]
    np.testing.assert_allclose(pose, expected @ tool, rtol=0, atol=1e-11)


def test_mappings_names_and_continuous_joints() -> None:
    row = {"theta": 0.1, "d": 0.2, "alpha": 0.3, "a": 0.4}
    chain = read_dh([row, row], [-np.inf, 0], [np.inf, 1], kinds="RP", names=["turn", "lift"], name="mine")
    assert chain.kinds == ("continuous", "prismatic")
    assert chain.joint_names == ("turn", "lift")
    assert (chain.name, chain.base, chain.tip) == ("mine", "base", "tool")
    plain = read_dh(np.array([(0.4, 0.3, 0.2, 0.1)] * 2), [-np.inf, 0], [np.inf, 1], kinds="RP")
    assert plain.joint_names == ("joint1", "joint2")
    np.testing.assert_array_equal(chain.fixed, plain.fixed)


ROW = (0.1, 0.2, 0.3, 0.4)
GOOD: dict[str, Any] = {"rows": [ROW, ROW], "lower": [-1, -1], "upper": [1, 1]}
BAD: list[tuple[dict[str, Any], str]] = [
    ({"rows": []}, "table is empty"),
    ({"rows": [ROW, ROW[:3]]}, "DH row 1: 3 values, expected 4: a, alpha, d, theta"),
    ({"rows": [ROW, (0, 0, np.nan, 0)]}, "DH row 1: contains NaN"),
    ({"rows": [ROW, ("x", 0, 0, 0)]}, "expected numbers"),
    (
        {"rows": [ROW, {"a": 0, "alfa": 0, "d": 0, "theta": 0}]},
        "expected the names a, alpha, d, theta, got a, alfa",
    ),
    ({"rows": [ROW, [0, 0, 0, [1, 2]]]}, "DH row 1: expected numbers"),
    ({"rows": [ROW, [[0], [0], [0], [0]]]}, r"DH row 1: an array of shape \(4, 1\), expected 4"),
    ({"rows": [ROW, {1: 0, "alpha": 0, "d": 0, "theta": 0}]}, "got 1, alpha, d, theta"),
    ({"convention": "modifed"}, "unknown DH convention 'modifed'; did you mean 'modified'"),
    ({"kinds": "RX"}, "unknown joint kind 'X'"),
    ({"kinds": "RRR"}, "kinds has 3 entries, expected 2"),
    ({"names": ["a"]}, "names has 1 entries, expected 2"),
    ({"names": ["a", "a"]}, "must be unique"),
    ({"lower": [-1]}, r"lower limits: expected shape \(2,\).*got \(1,\)"),
    ({"upper": 1.0}, r"upper limits: expected shape"),
    ({"upper": [1, np.nan]}, "upper limits: contain NaN"),
    ({"upper": [1, "x"]}, "upper limits: expected numbers"),
    ({"upper": [1, -2]}, "'joint2': lower limit -1.0 is above upper limit -2.0"),
    ({"upper": [1, np.inf]}, "'joint2': lower and upper limits must be finite"),
    (
        {"kinds": "RP", "lower": [-1, -np.inf], "upper": [1, np.inf]},
        "'joint2': lower and upper limits must be",
    ),
    ({"base": np.eye(3)}, r"base pose: a pose must have shape \(4, 4\) .* got \(3, 3\)"),
    (
        {"tool": np.diag([1, 1, -1, 1])},
        "tool pose: not a rigid transform: its determinant is -1, a reflection",
    ),
    ({"tool": np.full((4, 4), np.nan)}, "tool pose: a pose contains NaN or infinity"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_table_is_refused_with_a_reason(change: dict[str, Any], message: str) -> None:
    with pytest.raises(InvalidRobot, match=message):
        read_dh(**(GOOD | change))
