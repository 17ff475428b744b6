"""Options that several commands share."""

from __future__ import annotations

from collections.abc import Callable, Iterable

import click
from click.shell_completion import CompletionItem

from kinseek.errors import KinseekError

from .help import option, together

ARM = ("ARM", "A bundled arm (see: kinseek robots), or a .urdf, .xacro or MJCF .xml file.")
"""The first argument of most commands, for their help."""

GOAL = "The goal"


Completion = Callable[[click.Context, click.Parameter, str], list[CompletionItem]]


def complete(words: Callable[[], Iterable[str]]) -> Completion:
    """What a shell completes: the words that begin so."""

    def completed(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        return [CompletionItem(word) for word in words() if word.startswith(incomplete)]

    return completed


def complete_joints(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Joints of the arm that was named before, for JOINT=VALUE."""
    from kinseek.arm import load

    arm = ctx.params.get("arm") or next(iter(ctx.args), "")
    try:
        names = load(arm, ctx.params.get("base"), ctx.params.get("tip")).joint_names
    except KinseekError:
        return []
    return [CompletionItem(f"{name}=") for name in names if name.startswith(incomplete)]


def _complete_arms(ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Bundled arms that begin so, or files."""
    from kinseek.robots.catalog import catalog_names

    names = [name for name in catalog_names() if name.startswith(incomplete)]
    return [CompletionItem(name) for name in names] or [CompletionItem(incomplete, type="file")]


arm_argument = click.argument("arm", metavar="ARM", shell_complete=_complete_arms)

chain_options = together(
    option(
        "--base", metavar="LINK", group="The arm", help="Link that stays; the root of the file unless given."
    ),
    option(
        "--tip", metavar="LINK", group="The arm", help="Link whose pose is meant; the only leaf unless given."
    ),
)

pose_options = together(
    option("--at", metavar="X Y Z", group=GOAL, help="Wanted position of the tip in the base, m."),
    option(
        "--rpy", metavar="R P Y", group=GOAL, help="Roll, pitch, yaw about fixed x, y, z, as in URDF, rad."
    ),
    option("--quat-wxyz", metavar="W X Y Z", group=GOAL, help="Quaternion, real part first."),
    option("--quat-xyzw", metavar="X Y Z W", group=GOAL, help="Quaternion, real part last."),
    option("--rotvec", metavar="X Y Z", group=GOAL, help="Axis times angle, rad."),
)

json_option = option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
