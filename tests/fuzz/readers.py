"""Which reader gets which file, and how that ended."""

from __future__ import annotations

import json
import re
import traceback
import warnings
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from kinseek import Arm, Goal
from kinseek.cli.files import read_poses
from kinseek.cli.json_lines import _read, _target
from kinseek.collision.bodies import ArmBodies, arm_bodies
from kinseek.collision.obstacles import obstacles
from kinseek.collision.pairs import disabled_by
from kinseek.errors import InvalidRobot, KinseekError
from kinseek.robots import SerialChain, read, read_dh, read_urdf
from kinseek.robots.files import ENDINGS
from kinseek.robots.srdf import read_srdf

CORPUS = Path(__file__).resolve().parent / "corpus"
"""Files to start from; README.md there says of each why."""


def kind_of(path: Path) -> str:
    """What chooses the reader: the ending, or the last two of a name that has two, such as ``.goal.json``."""
    both = "".join(path.suffixes[-2:]).lower()
    return both if both in READERS else path.suffix.lower()


def judge(path: Path) -> str:
    """Read a file, and say how that ended: ``loaded``, ``refused``, or what is wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            READERS.get(kind_of(path), an_arm)(path)
    except KinseekError:
        return "refused"
    except AssertionError as error:
        return f"WRONG {error}"
    except BaseException:
        return "EXCEPTION " + traceback.format_exc()
    return "loaded"


def an_arm(path: Path) -> None:
    """Read an arm, without trust where the file is called so; where it branches, up to a tip that the message names."""
    trusted = not path.name.startswith("untrusted")
    try:
        chain = read(path, trusted=trusted)
    except InvalidRobot as error:
        tips = re.search(r"Choose tip= from: ([^,;]+)", str(error))
        if tips is None or tips[1].startswith("none"):
            raise
        chain = read(path, tip=tips[1], trusted=trusted)
    check(chain)


def check(chain: SerialChain) -> None:
    """An arm has numbers, limits in order, turns that are turns and names of its own."""
    numbers = [chain.lower, chain.upper, chain.fixed, chain.multiplier, chain.offset]
    assert all(np.isfinite(array).all() for array in numbers), "not finite"
    assert (chain.lower <= chain.upper).all(), f"limits crossed: {chain.lower} {chain.upper}"
    turns = chain.fixed[:, :, :3]
    assert np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3)).max() <= 1e-4, "no rotation"
    assert len(chain.joint_names) == len(set(chain.joint_names)) == len(chain.lower) > 0, "names"


def a_table(path: Path) -> None:
    """Denavit-Hartenberg parameters: the arguments of `Arm.from_dh`, as JSON."""
    check(read_dh(**_object(path, ("rows", "lower", "upper"), DH)))


DH = ("rows", "lower", "upper", "convention", "kinds", "names", "base", "tool", "name")


def some_obstacles(path: Path) -> None:
    """Obstacles of a URDF file or of MoveIt."""
    bodies, _ = obstacles(path, {}, skip=True, trusted=False)
    for body in bodies:
        assert body.parts, f"{body.name} has no shape"
        assert all(np.isfinite(part.pose).all() for part in body.parts), f"{body.name}: a pose is not finite"


@cache
def _bodies() -> ArmBodies:
    chain = read_urdf(CORPUS / "every_joint.urdf")
    return arm_bodies(chain, {}, None, None, {}, skip=True)


def some_pairs(path: Path) -> None:
    """Pairs that an SRDF file disables, and the arms that are its groups."""
    pairs, _ = disabled_by(path, _bodies(), trusted=False)
    assert all(len(pair) == 2 for pair in pairs), "no pair"
    for group in list(read_srdf(path, trusted=False).groups)[:5]:
        arm = Arm(read(CORPUS / "every_joint.urdf", srdf=path, group=group, trusted=False))
        check(arm.chain)
        assert all(np.isfinite(list(state.values())).all() for state in arm.states.values()), "a state"


def a_calibration(path: Path) -> None:
    """Measured origins of the joints of a bundled arm."""
    check(read("ur5e", calibration=path))


def some_limits(path: Path) -> None:
    """Limits of the joints of a bundled arm, which stay above 0 or unknown."""
    chain = read("ur5e", limits=path)
    check(chain)
    assert not (chain.rates <= 0).any(), "a limit is not above 0"
    assert not np.isinf(chain.rates).any(), "a limit is infinite"


def some_poses(path: Path) -> None:
    """A table of poses, as `kinseek solve --batch` reads it."""
    _rigid(read_poses(path, position_only=False, deg=False))


def some_lines(path: Path) -> None:
    """Poses a line, as `kinseek solve --jsonl` reads them; the first that is wrong is refused, the others are read first."""
    refused = None
    for number, text in enumerate(path.read_bytes().split(b"\n"), 1):
        if text.strip():
            try:
                _rigid(np.asarray(_target(_read(text), number, False, False))[None])
            except KinseekError as error:
                refused = refused or error
    if refused:
        raise refused


def a_goal(path: Path) -> None:
    """The arguments of a goal, as JSON: what is to be met under its kind, all others by their names."""
    given = _object(path, (), (*GOALS, *OPTIONS, *RANGES, "tool_axis"))
    for kind, (make, own) in GOALS.items():
        if kind in given:
            first = given[kind] if kind == "pointing" else [given[kind]]
            if not isinstance(first, list) or len(first) != (2 if kind == "pointing" else 1):
                raise InvalidRobot("a direction needs a place")
            goal = make(*first, **{name: value for name, value in given.items() if name in (*own, *OPTIONS)})
            _rigid(goal.target)
            return
    raise InvalidRobot("no goal")


RANGES = ("free", "box", "frame")
OPTIONS = (
    *("tool", "base"),
    *("position_tolerance", "orientation_tolerance", "position_weight", "orientation_weight"),
)
GOALS: dict[str, tuple[Callable[..., Goal], tuple[str, ...]]] = {
    "pose": (Goal.pose, RANGES),
    "position": (Goal.position, ()),
    "pointing": (Goal.pointing, ("free", "box", "tool_axis")),
}
"""What makes each kind, and which names it takes beside those of all."""


def _object(path: Path, needed: tuple[str, ...], known: tuple[str, ...]) -> dict[str, Any]:
    """A JSON file as arguments; what Python itself would refuse, a name too many or one that is missing, is refused here."""
    try:
        found = json.loads(path.read_bytes())
    except (ValueError, RecursionError) as error:
        raise InvalidRobot("not JSON") from error
    if not isinstance(found, dict) or not set(needed) <= set(found) <= set(known):
        raise InvalidRobot("other arguments")
    return found


def _rigid(poses: Any) -> None:
    poses = np.asarray(poses).reshape(-1, 4, 4)
    assert np.isfinite(poses).all(), "a pose is not finite"
    turns = poses[:, :3, :3]
    assert np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3)).max(initial=0.0) <= 1e-9, "no rotation"


READERS: Mapping[str, Callable[[Path], None]] = {
    **dict.fromkeys(ENDINGS, an_arm),
    ".dh.json": a_table,
    ".obstacles.urdf": some_obstacles,
    ".scene": some_obstacles,
    ".srdf": some_pairs,
    ".calibration.yaml": a_calibration,
    ".limits.yaml": some_limits,
    ".csv": some_poses,
    ".jsonl": some_lines,
    ".goal.json": a_goal,
}
"""By the end of a file's name."""
