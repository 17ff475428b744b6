"""Conversion of command-line words to numbers: lists after an option, negative numbers, joint values."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidProblem, suggest
from kinseek.robots.named import in_order
from kinseek.support.units import warn_of_angles

LENGTHS = {
    "--at": 3,
    "--rpy": 3,
    "--quat-wxyz": 4,
    "--quat-xyzw": 4,
    "--rotvec": 3,
    "--z-axis": 3,
    "--x-axis": 3,
    "--y-axis": 3,
    "--tool": 6,
    "--range": 6,
    "--near": None,
    "--start": None,
    "--end": None,
    "--lock": None,
    "--velocity": None,
    "--acceleration": None,
    "--jerk": None,
}
"""Options that take a list, and its length; None means any number of values, or of JOINT=VALUE."""


def join_lists(words: Sequence[str]) -> list[str]:
    """Join the numbers after an option of `LENGTHS` into one word, and protect the numbers of ``fk``.

    So a list may be written ``--at -0.3 0 0.4`` or ``--at -0.3,0,0.4``, and a minus sign does not start an option.
    """
    if words[:1] == ["fk"]:
        return _numbers_last(words)
    joined: list[str] = []
    rest = list(words)
    while rest:
        word = rest.pop(0)
        if word not in LENGTHS:
            joined.append(word)
            continue
        most, taken = LENGTHS[word], list[str]()
        while rest and (is_number(rest[0]) or _is_named(rest[0], most) or _belongs(rest[0], most, taken)):
            taken.append(rest.pop(0))
        joined.append(f"{word}={' '.join(taken)}")
    return joined


def is_number(word: str) -> bool:
    """Return whether every part of the word between commas and blanks is a number, including NaN and infinity."""
    try:
        return (
            word.isascii()
            and "_" not in word
            and bool([float(part) for some in word.split() for part in some.split(",")])
        )
    except ValueError:
        return False


def numbers(text: str, option: str, count: int | None = None) -> list[float]:
    """Read numbers separated by blanks or commas.

    Raises:
        InvalidProblem: Another number of values than `count`, or words that are not numbers.
    """
    words = split(text)
    for word in words:
        if not is_number(word):
            raise InvalidProblem(f"{option}: {word!r} is not a number")
    if count is not None and len(words) != count:
        raise InvalidProblem(f"{option} needs {count} numbers, got {len(words)}: {text or 'none'}")
    return [float(word) for word in words]


def split(text: str) -> list[str]:
    """Return the words of a list, which are separated by blanks or commas."""
    return text.replace(",", " ").split()


def option_of(field: str) -> str:
    """Return a field's name as an option."""
    return "--" + field.replace("_", "-")


def size(text: str | None, option: str) -> int | None:
    """Read a size in bytes, with ``64k`` and ``4M`` for multiples of 1024 and 1024²; None if it is not given.

    Raises:
        InvalidProblem: It is not a size.
    """
    if text is None:
        return None
    times = {"k": 1024, "m": 1024**2}.get(text[-1:].lower(), 1)
    digits = text if times == 1 else text[:-1]
    if not (digits.isascii() and digits.isdigit() and len(digits) <= 15):
        raise InvalidProblem(f"{option}: {text!r:.80} is not a number of bytes; valid: 65536, 64k or 4M")
    return int(digits) * times


def named_values(text: str, option: str) -> dict[str, float]:
    """Read JOINT=VALUE separated by blanks or commas.

    Raises:
        InvalidProblem: Something else, a repeated joint, or no value.
    """
    found: dict[str, float] = {}
    for word in split(text):
        name, equals, value = word.rpartition("=")
        if not (equals and name):
            raise InvalidProblem(f"{option} takes JOINT=VALUE, got {word!r}")
        if name in found:
            raise InvalidProblem(f"{option} names the joint {name!r} twice")
        found[name] = numbers(value, f"{option} {name}", 1)[0]
    if not found:
        raise InvalidProblem(f"{option} takes JOINT=VALUE, got nothing")
    return found


def preference(text: str, option: str, degrees: bool) -> str | dict[str, str | float]:
    """Read one word, or a posture as NAME=VALUE separated by commas, with an angle in [rad] unless `degrees` is set.

    Raises:
        InvalidProblem: A part of a posture is not NAME=VALUE, or names something twice.
    """
    if "=" not in text:
        return text
    posture: dict[str, str | float] = {}
    for word in split(text):
        name, equals, value = word.partition("=")
        if not (equals and name and value):
            raise InvalidProblem(f"{option} takes a word or NAME=VALUE, got {word!r}")
        if name in posture:
            raise InvalidProblem(f"{option} names {name!r} twice")
        angle = float(value) if is_number(value) and "," not in value else None
        if angle is not None and not degrees:
            warn_of_angles([angle], f"{option} {name}", "add --deg", 1)
        posture[name] = value if angle is None else float(np.deg2rad(angle)) if degrees else angle
    return posture


def in_radians(arm: Arm, values: Mapping[str, float], option: str, degrees: bool) -> dict[str, float]:
    """Convert values of some joints to [m] for a prismatic joint, else [rad]; the input may be in degrees.

    Raises:
        InvalidProblem: The arm has no such joint.
    """
    kinds = dict(zip(arm.joint_names, arm.kinds, strict=True))
    for name in values:
        if name not in kinds:
            raise InvalidProblem(f"{option}: {suggest(name, kinds, 'joint')}")
    turned = {name for name in values if degrees and kinds[name] != "prismatic"}
    return {name: float(np.deg2rad(value)) if name in turned else value for name, value in values.items()}


def joint_values(arm: Arm, text: str, option: str, degrees: bool) -> NDArray[np.float64]:
    """Read one number per joint, or JOINT=VALUE of every joint, as `joints_in_order` takes them.

    Raises:
        InvalidProblem: Not one number per joint.
    """
    values = named_values(text, option) if "=" in text else numbers(text, option)
    return joints_in_order(arm, values, option, degrees)


def joints_in_order(
    arm: Arm, values: Sequence[float] | Mapping[str, float], option: str, degrees: bool
) -> NDArray[np.float64]:
    """Return joint values, (n,), [m] for a prismatic joint, else [rad], from one number per joint in order or by name.

    Raises:
        InvalidProblem: Not one number per joint.
    """
    values = in_order(values, arm.joint_names, option, InvalidProblem)
    if len(values) != arm.dof:
        names = ", ".join(arm.joint_names)
        raise InvalidProblem(f"{option} needs {arm.dof} numbers, got {len(values)}. Joints: {names}")
    q = np.array(values, dtype=np.float64)
    turns = np.array([kind != "prismatic" for kind in arm.kinds])
    if not degrees:  # Many turns are expected if the limits are as wide.
        outside = turns & ((q < arm.lower) | (q > arm.upper))
        warn_of_angles(np.where(outside & np.isfinite(q), q, 0.0), option, "add --deg", 1)
    return np.where(turns & degrees, np.deg2rad(q), q)


def limits(arm: Arm, text: str, option: str) -> float | NDArray[np.float64]:
    """Read one number for all joints, one per joint, or JOINT=VALUE of every joint: a number or (n,).

    Raises:
        InvalidProblem: Something else.
    """
    values = named_values(text, option) if "=" in text else numbers(text, option)
    if len(values) == 1 and isinstance(values, list):
        return values[0]
    listed = in_order(values, arm.joint_names, option, InvalidProblem)
    if len(listed) != arm.dof:
        names = ", ".join(arm.joint_names)
        raise InvalidProblem(f"{option} needs 1 or {arm.dof} numbers, got {len(listed)}. Joints: {names}")
    return np.array(listed, dtype=np.float64)


def _is_named(word: str, most: int | None) -> bool:
    """Return whether a word is JOINT=VALUE after an option that takes them."""
    return most is None and "=" in word and not word.startswith("-")


def _belongs(word: str, most: int | None, taken: Sequence[str]) -> bool:
    """Return whether a word that is not a number still belongs to the list before it, so that its error can say so."""
    return most is not None and len(taken) < most and not word.startswith("--") and "," not in "".join(taken)


_NAMES = frozenset(("--base", "--tip", "--group", "--srdf", "--calibration", "--limits"))
"""Options of names, of which a number may be one: a link may be called 1."""


def _numbers_last(words: Sequence[str]) -> list[str]:
    options, values = list[str](), list[str]()
    for before, word in zip(("", *words), words, strict=False):
        named = before in _NAMES
        (values if is_number(word) and not named else options).append(word)
    return [*(word for word in options if word != "--"), "--", *values]
