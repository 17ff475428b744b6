"""``kinseek view``."""

from __future__ import annotations

import click

from kinseek.cli.help import Command, option
from kinseek.cli.options import Robot, robot_options
from kinseek.cli.output import direct_output
from kinseek.cli.scenes import Cell, scene_options


@click.command(
    "view",
    cls=Command,
    examples=[
        "kinseek view panda",
        "kinseek view ur5e --scene cell.urdf --capsules 0.05",
        "kinseek view ur5e --port 9000 --no-browser",
    ],
    more=["Without --host only this machine reaches the page; with --host 0.0.0.0 the network does."],
)
@robot_options
@scene_options
@option("--host", metavar="ADDRESS", default="127.0.0.1", help="Address to listen at.")
@option(
    "--port",
    metavar="N",
    type=click.IntRange(0, 65535),
    default=8080,
    help="Port to listen at; if it is taken, the next free one is used.",
)
@option("--share", is_flag=True, help="Also make a public address, through a relay of viser's authors.")
@option("--browser/--no-browser", default=None, help="Open a browser, or only print the address of the page.")
def command(
    robot: Robot,
    cell: Cell,
    host: str,
    port: int,
    share: bool,
    browser: bool | None,
) -> int:
    """Show an arm in the browser: drag a goal, and see the solution, every branch and the error.

    It ends with Ctrl-C.
    """
    from kinseek.viewer import show  # It says itself what has to be installed.

    # Packages of a .urdf file are for its meshes alone, and `load` has no use for them.
    expanded = robot.arm.lower().endswith(".xacro")
    loaded = (robot if expanded else robot._replace(packages={})).load()
    with direct_output():
        show(
            loaded,
            scene=cell.of(loaded, robot),
            clearance=cell.clearance,
            host=host,
            port=port,
            share=share,
            open_browser=browser,
            packages=robot.packages,
        )
    return 0
