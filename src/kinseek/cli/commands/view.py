"""``kinseek view``."""

from __future__ import annotations

import click

from kinseek.arm import load
from kinseek.cli.help import Command, option
from kinseek.cli.options import ARM, arm_argument, chain_options
from kinseek.cli.output import direct_output
from kinseek.errors import InvalidProblem


@click.command(
    "view",
    cls=Command,
    arguments=[ARM],
    examples=["kinseek view panda", "kinseek view ur5e --port 9000 --no-browser"],
    more=["Without --host only this machine reaches the page; with --host 0.0.0.0 the network does."],
)
@arm_argument
@chain_options
@option("--host", metavar="ADDRESS", default="127.0.0.1", help="Address to listen at. Default: 127.0.0.1.")
@option(
    "--port",
    metavar="N",
    type=click.IntRange(0, 65535),
    default=8080,
    help="Port to listen at; if it is taken, the next free one is. Default: 8080.",
)
@option("--browser/--no-browser", default=None, help="Open a browser, or only say where the page is.")
@option(
    "--package",
    metavar="NAME=FOLDER",
    multiple=True,
    help="Where the ROS package is that a robot's file names in package://NAME; once for each.",
)
def command(
    arm: str,
    base: str | None,
    tip: str | None,
    host: str,
    port: int,
    browser: bool | None,
    package: tuple[str, ...],
) -> int:
    """Show an arm on a page in the browser: drag a goal, see the answer, every branch, and how near it comes.

    It ends with Ctrl-C.
    """
    from kinseek.viewer import show  # It says itself what has to be installed.

    loaded, packages = load(arm, base, tip), _folders(package)
    with direct_output():
        show(loaded, host=host, port=port, open_browser=browser, packages=packages)
    return 0


def _folders(given: tuple[str, ...]) -> dict[str, str]:
    folders = {}
    for text in given:
        name, equals, folder = text.partition("=")
        if not (name and equals and folder):
            raise InvalidProblem(f"--package takes NAME=FOLDER, got {text!r}")
        folders[name] = folder
    return folders
