"""``kinseek solve``: one pose, every answer to it, a file of poses, or poses line by line."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any, cast

import click

from kinseek.arm import Arm
from kinseek.branches.order import ORDERS
from kinseek.branches.result import Branches
from kinseek.cli import report
from kinseek.cli.batch import solve_file
from kinseek.cli.columns import VALID
from kinseek.cli.goals import GoalSpec, PoseWords
from kinseek.cli.help import Command, option
from kinseek.cli.json_lines import solve_lines
from kinseek.cli.options import (
    GOAL,
    Robot,
    complete,
    complete_joints,
    goal_options,
    json_option,
    pose_options,
    robot_options,
)
from kinseek.cli.request import SolveRequest
from kinseek.cli.scenes import Cell, scene_options
from kinseek.cli.searches import make_search, search_options, searches, searches_in_words
from kinseek.cli.words import in_radians, joint_values, named_values, option_of, preference
from kinseek.errors import InvalidProblem
from kinseek.goal import Goal

_WHICH = "Choice of solutions"
_MANY = "Many poses"


@click.command(
    "solve",
    cls=Command,
    examples=[
        "kinseek solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg",
        "kinseek solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg --all",
        "kinseek solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg --free z,rz --lock wrist_3_joint=0",
        "kinseek solve ur5e --at 0.4 0.2 0.3 --z-axis 0 0 -1 --x-axis 1 0 0 --tool 0 0 0.1 --box rx=-0.1:0.1",
        "kinseek solve planar2 --at 0.3 0.4 0 --position-only --near joint1=0.2,joint2=1.5",
        "kinseek solve panda --at 0.4 0.1 0.5 --quat-wxyz 0 1 0 0 --prefer limits --json",
        "kinseek solve ur5e --at 0.4 0.2 0.3 --rpy 180 0 0 --deg --scene cell.urdf --capsules 0.05 --clearance 0.01",
        "kinseek solve ur5e --batch poses.csv --out answers.csv",
        "kinseek solve ur5e --jsonl < poses.jsonl",
    ],
    more=[
        f"Columns of --batch, lengths in m, angles in rad: {VALID}. With --position-only those of a rotation may be "
        "omitted. A line of --jsonl is an object such as "
        '{"position": [0.4, 0.2, 0.3], "rpy": [3.14, 0, 0]}; quat_wxyz, quat_xyzw, rotvec, or z_axis with x_axis may '
        "replace rpy, matrix may replace both, and id and near are optional.",
        "Exit codes: 0 reached, 1 not reached, 2 misuse, or a wrong line of --jsonl; 130 stopped with Ctrl-C.",
    ],
)
@pose_options
@option(
    "--deg",
    is_flag=True,
    group=GOAL,
    help="Angles of --rpy, --rotvec, --near, --lock, --tool, --box, --cone and arm_angle are in degrees.",
)
@robot_options
@option(
    "--lock",
    metavar="JOINT=VALUE",
    multiple=True,
    shell_complete=complete_joints,
    group="The arm",
    help="Joints that are locked at a value, rad or m; separated by blanks or commas.",
)
@scene_options
@option(
    "--near",
    metavar="Q...",
    shell_complete=complete_joints,
    group=_WHICH,
    help="Joint values to stay near to, or to start from, rad or m: one per joint, or JOINT=VALUE for every joint.",
)
@option(
    "--prefer",
    metavar="WORD",
    shell_complete=complete(lambda: (*ORDERS, "elbow=up", "elbow=down")),
    group=_WHICH,
    help="The best of all solutions: mid-range (nearest to the middle of the limits), limits (farthest from them) or "
    "dexterity (farthest from singular); or a posture such as elbow=up,wrist=flip or arm_angle=0.5, rad.",
)
@option(
    "--all",
    "every",
    is_flag=True,
    group=_WHICH,
    help="Every distinct solution, or a spread sample if the arm is redundant; --near or --prefer sets the order.",
)
@option(
    "--count", metavar="N", type=click.IntRange(1), group=_WHICH, help="Maximum number of solutions of --all."
)
@option(
    "--prove",
    is_flag=True,
    group=_WHICH,
    help="Prove that a missed pose has no solution, or that --all found every solution.",
)
@goal_options
@option(
    "--batch",
    type=click.Path(path_type=Path),
    metavar="FILE",
    group=_MANY,
    help="Poses in a .csv or .parquet file, or an array (N, 4, 4) in a .npy file, in place of --at.",
)
@option(
    "--out",
    type=click.Path(path_type=Path),
    metavar="FILE",
    group=_MANY,
    help="Output file of --batch, .csv, .npy or .parquet; written once all solutions are computed.",
)
@option(
    "--jsonl",
    is_flag=True,
    group=_MANY,
    help="Read one pose per line from standard input, in place of --at, and write one solution per line without delay.",
)
@option("--trace", is_flag=True, help="Print the trace of the search, pass by pass.")
@json_option
@option(
    "--solver",
    metavar="NAME",
    shell_complete=complete(searches),
    group="The search",
    lazy_help=searches_in_words,
)
@search_options()
def command(
    words: PoseWords,
    goal_spec: GoalSpec,
    deg: bool,
    robot: Robot,
    lock: tuple[str, ...],
    cell: Cell,
    near: str | None,
    prefer: str | None,
    every: bool,
    count: int | None,
    prove: bool,
    batch: Path | None,
    out: Path | None,
    jsonl: bool,
    trace: bool,
    as_json: bool,
    solver: str | None,
    **more: Any,
) -> int:
    """Find joint values that reach a pose."""
    loaded = _locked(robot.load(), lock, deg)
    chosen = None if prefer is None else preference(prefer, "--prefer", deg)
    request = SolveRequest(
        loaded,
        goal_spec,
        deg,
        near=None if near is None else joint_values(loaded, near, "--near", deg),
        search=make_search(solver, more),
        prefer=chosen,
        prove=prove,
        trace=trace,
        scene=cell.of(loaded, robot),
        clearance=cell.clearance,
        every=every,
        count=count,
    )
    if near is not None and isinstance(chosen, str):
        raise InvalidProblem(
            "--near and --prefer cannot be combined, since each selects the best solution; give one of them"
        )
    if count is not None and not every:
        raise InvalidProblem("--count limits the number of solutions of --all; add --all")
    if batch is None and out is not None:
        where = ", and --jsonl prints its solutions" if jsonl else "; add --batch FILE"
        raise InvalidProblem(f"--out names the output file of --batch{where}")
    if batch is None and not jsonl:
        return _one(request, goal_spec.goal(words.target(goal_spec.position_only, deg), deg), as_json)
    single = [*map(option_of, words.given), *(["--trace"] if trace else [])]
    if single:
        many = "--jsonl" if jsonl else "--batch"
        raise InvalidProblem(f"{many} reads many poses; it cannot be combined with {' or '.join(single)}")
    if batch is None:
        return solve_lines(request)
    if jsonl or out is None:
        raise InvalidProblem(
            "--batch and --jsonl cannot be combined" if jsonl else "--batch needs --out FILE"
        )
    return solve_file(request, batch, out, as_json)


def _locked(arm: Arm, lock: tuple[str, ...], deg: bool) -> Arm:
    if not lock:
        return arm
    return arm.with_locked(in_radians(arm, named_values(" ".join(lock), "--lock"), "--lock", deg))


def _one(request: SolveRequest, goal: Goal, as_json: bool) -> int:
    clock, proof, in_scene = time.perf_counter(), None, request.scene is not None
    if request.every:
        found = request.branches(goal)
        seconds = time.perf_counter() - clock
        report.print_branches(request.arm, cast(Branches, found), seconds, as_json, in_scene)
        return 0 if len(found) else 1
    if request.prove:
        solution, proof = request.solve_with_proof(goal)
    else:
        solution = request.solve(goal)
    seconds = time.perf_counter() - clock
    report.print_solution(request.arm, solution, request.search, seconds, as_json, proof, in_scene)
    return 0 if solution.success else 1
