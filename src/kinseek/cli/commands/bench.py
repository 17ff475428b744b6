"""``kinseek bench``."""

from __future__ import annotations

import click

from kinseek.cli import bench, report
from kinseek.cli.help import Command, option
from kinseek.cli.options import ARM, Chain, arm_argument, chain_options, json_option
from kinseek.cli.output import complain, on_terminal
from kinseek.cli.peers import PEERS


@click.command(
    "bench",
    cls=Command,
    arguments=[ARM],
    examples=["kinseek bench planar2 --poses 50 --seconds 0.05"],
    more=[
        f"Peers, each measured if it is installed: {', '.join(f'{peer.name} ({peer.package})' for peer in PEERS)}."
    ],
)
@arm_argument
@chain_options
@option("--poses", metavar="N", type=click.IntRange(1), default=1000, help="Poses to solve. Default: 1000.")
@option(
    "--seconds",
    metavar="S",
    type=click.FloatRange(0, min_open=True),
    default=2.0,
    help="Time for each line of the table; a slow solver solves fewer poses in it. Default: 2.",
)
@json_option
def command(arm: str, chain: Chain, poses: int, seconds: float, as_json: bool) -> int:
    """Measure how long solutions take on this machine, for kinseek and for the peers that are installed.

    The poses belong to random postures inside the limits. A pose is reached if the solution is inside the limits and within
    1e-6 m and 1e-6 rad by kinseek's plain forward kinematics; if every solution is requested, each has to be. A peer that
    needs a start gets the middle of the ranges, or, near a start, a posture about 0.05 rad or m away in each joint.
    Unreachable poses are farther away than the links together are long: solvers look for the nearest pose, or prove that
    none exists.
    """
    loaded, rows = chain.load(arm), []
    for row in bench.measure(loaded, poses, seconds):
        rows.append(row)
        if on_terminal():
            complain(f"measured: {row.what}, {row.who}")
    report.print_bench(loaded, rows, bench.machine(), as_json)
    return 0
