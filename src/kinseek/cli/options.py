"""Options that several commands share."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

import click
from click.shell_completion import CompletionItem

from kinseek.arm import Arm, load
from kinseek.errors import InvalidProblem, KinseekError
from kinseek.tolerances import DEFAULT_TOLERANCE, DEFAULT_WEIGHT

from .goals import GoalSpec, PoseWords
from .help import Declaration, argument, bundle, option
from .words import is_number

GOAL, TOLERANCES = "The goal", "Tolerances and weights"
"""Groups of options."""

Completion = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def complete(words: Callable[[], Iterable[str]]) -> Completion:
    """Return a completion of the words that start with the incomplete one."""

    def completed(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(word) for word in words() if word.startswith(incomplete)]

    return completed


class Robot(NamedTuple):
    """A bundled arm or the file of a robot, which part of it is the arm, and the options for reading it."""

    arm: str
    """Name of the bundled arm, or path of the file."""
    base: str | None
    tip: str | None
    args: dict[str, str]
    """Arguments of a xacro file, by name."""
    packages: dict[str, str]
    """Folders of ROS packages, by name."""
    untrusted: bool
    """Is the file from an untrusted source?"""
    calibration: str | None
    """File with measured origins of joints."""
    srdf: str | None
    """SRDF file."""
    group: str | None
    """Group of the SRDF file."""
    limits: dict[str, tuple[float, float]] | str
    """Lower and upper limits of joints by name, [rad] or [m]; or a joint_limits.yaml."""

    def load(self) -> Arm:
        """Load the arm.

        Raises:
            KinseekError: As `kinseek.load`.
        """
        return load(
            self.arm,
            self.base,
            self.tip,
            args=self.args,
            packages=self.packages,
            trusted=not self.untrusted,
            calibration=self.calibration,
            srdf=self.srdf,
            group=self.group,
            limits=self.limits or None,
        )


_PLAIN = re.compile(r"[A-Za-z0-9_./:-]+")
"""A name that no shell interprets as a command, a pattern, several words or several lines."""


def complete_joints(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete JOINT=VALUE with joints of the arm named earlier.

    A shell inserts a completion unquoted, so joints with other characters in their names are left out. ``--untrusted`` may
    still follow on the line, so no file is trusted here.
    """
    given: dict[str, Any] = {name: ctx.params.get(name) for name in Robot._fields}
    given |= {"arm": given["arm"] or next(iter(ctx.args), ""), "untrusted": True}
    try:
        with warnings.catch_warnings():  # Printed below what is being typed.
            warnings.simplefilter("ignore")
            names = Robot(**given).load().joint_names
    except KinseekError:
        return []
    plain = filter(_PLAIN.fullmatch, names)
    return [CompletionItem(f"{name}=") for name in plain if name.startswith(incomplete)]


def _complete_arms(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Complete bundled arms, or files."""
    from kinseek.robots.catalog import catalog_names

    names = [name for name in catalog_names() if name.startswith(incomplete)]
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


def _pairs(ctx: click.Context, param: click.Parameter, given: tuple[str, ...]) -> dict[str, str]:
    """Read NAME=TEXT, each name once."""
    pairs: dict[str, str] = {}
    for text in given:
        name, equals, value = text.partition("=")
        if not (name and equals):
            raise InvalidProblem(f"{param.opts[0]} takes {param.metavar}, got {text!r}")
        if name in pairs:
            raise InvalidProblem(f"{param.opts[0]} names {name!r} twice")
        pairs[name] = value
    return pairs


def _limits(
    context: click.Context, param: click.Parameter, given: tuple[str, ...]
) -> dict[str, tuple[float, float]] | str:
    """Read NAME=LOWER,UPPER, each name once; or the path of one file."""
    if len(given) == 1 and ("=" not in given[0] or Path(given[0]).is_file()):
        return given[0]
    ranges: dict[str, tuple[float, float]] = {}
    for name, value in _pairs(context, param, given).items():
        words = value.split(",")
        if len(words) != 2 or not is_number(value):
            raise InvalidProblem(f"{param.opts[0]} takes {param.metavar}, got {name}={value}")
        ranges[name] = float(words[0]), float(words[1])
    return ranges


robot_options = bundle(
    "robot",
    Robot,
    argument(
        "arm",
        metavar="ARM",
        shell_complete=_complete_arms,
        help="A bundled arm (see: kinseek robots), or a .urdf, .xacro or MJCF .xml file.",
    ),
    option("--base", metavar="LINK", group="The arm", help="Base link. Default: the root of the file."),
    option("--tip", metavar="LINK", group="The arm", help="Tip link. Default: the only leaf of the file."),
    option(
        "--arg",
        "args",
        metavar="NAME=VALUE",
        multiple=True,
        callback=_pairs,
        group="The arm",
        help="Argument of a xacro file; repeat it for each.",
    ),
    option(
        "--package",
        "packages",
        metavar="NAME=FOLDER",
        multiple=True,
        callback=_pairs,
        group="The arm",
        help="Folder of a ROS package that the file refers to by $(find NAME) or package://NAME; repeat it for each.",
    ),
    option(
        "--untrusted",
        is_flag=True,
        group="The arm",
        help="Do not trust a xacro file: read it without Python, and reject expressions that need it.",
    ),
    option(
        "--calibration",
        metavar="FILE",
        type=click.Path(),
        group="The arm",
        help="Measured origins of joints, as ur_calibration writes them for a Universal Robots arm.",
    ),
    option(
        "--srdf",
        metavar="FILE",
        type=click.Path(),
        group="The arm",
        help="SRDF file of the robot; its disabled pairs may touch.",
    ),
    option("--group", metavar="NAME", group="The arm", help="Group of the SRDF file that is the arm."),
    option(
        "--limits",
        metavar="NAME=LOWER,UPPER|FILE",
        multiple=True,
        callback=_limits,
        group="The arm",
        help="Limits of a joint, rad or m; repeat it for each. A planar joint NAME needs those of NAME/x and NAME/y. "
        "Or a joint_limits.yaml of MoveIt.",
    ),
)


pose_options = bundle(
    "words",
    PoseWords,
    option("--at", metavar="X Y Z", group=GOAL, help="Target position of the tip in the base, m."),
    option(
        "--rpy", metavar="R P Y", group=GOAL, help="Roll, pitch, yaw about fixed x, y, z, as in URDF, rad."
    ),
    option("--quat-wxyz", metavar="W X Y Z", group=GOAL, help="Quaternion, real part first."),
    option("--quat-xyzw", metavar="X Y Z W", group=GOAL, help="Quaternion, real part last."),
    option("--rotvec", metavar="X Y Z", group=GOAL, help="Axis times angle, rad."),
    option(
        "--z-axis",
        metavar="X Y Z",
        group=GOAL,
        help="Direction of the tip's z axis, of any length; with one other axis, in place of a rotation.",
    ),
    option("--x-axis", metavar="X Y Z", group=GOAL, help="Direction of the tip's x axis."),
    option("--y-axis", metavar="X Y Z", group=GOAL, help="Direction of the tip's y axis."),
)


def _number(name: str, metavar: str, default: float, help: str) -> Declaration:
    """Declare a tolerance or a weight."""
    return option(name, type=float, metavar=metavar, default=default, group=TOLERANCES, help=help)


goal_options = bundle(
    "goal_spec",
    GoalSpec,
    option("--position-only", is_flag=True, group=GOAL, help="Any orientation is allowed."),
    option(
        "--free",
        metavar="AXES",
        group=GOAL,
        help="Free axes: their deviation does not matter, e.g. rz or z,rx,ry.",
    ),
    option(
        "--box",
        metavar="AXIS=LOW:HIGH",
        multiple=True,
        group=GOAL,
        help="Ranges of accepted deviations, m or rad, e.g. z=-0.01:0.01,rx=-0.1:0.1.",
    ),
    option(
        "--cone",
        type=float,
        metavar="RAD",
        default=0.0,
        group=GOAL,
        help="With one free rotation: how far its axis may tilt, rad.",
    ),
    option(
        "--frame",
        metavar="WORD",
        default="tool",
        shell_complete=complete(lambda: ("tool", "base")),
        group=GOAL,
        help="Frame of the axes of --free and --box: tool (that of the target pose) or base.",
    ),
    option(
        "--tool",
        metavar="X Y Z [R P Y]",
        group=GOAL,
        help="Pose of a tool at the tip, m and rad: the poses are those of the tool.",
    ),
    _number(
        "--position-tolerance", "M", DEFAULT_TOLERANCE, "Largest position error that counts as reached, m."
    ),
    _number(
        "--orientation-tolerance",
        "RAD",
        DEFAULT_TOLERANCE,
        "Largest orientation error that counts as reached, rad, also with --deg.",
    ),
    _number("--position-weight", "X", DEFAULT_WEIGHT, "K_P of the weighted error, per m."),
    _number("--orientation-weight", "X", DEFAULT_WEIGHT, "K_A of the weighted error."),
)

json_option = option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
