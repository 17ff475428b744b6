"""The commands; what they print is made in `report`."""

from __future__ import annotations

import re
import time
import warnings
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, cast

import numpy as np
import typer
from numpy.typing import NDArray

import kinseek
from kinseek.arm import load
from kinseek.errors import InvalidExport, InvalidGoal, KinseekError, UnitWarning, suggest
from kinseek.export import TARGETS, checked_folder, prepare
from kinseek.goal import Frame, Goal
from kinseek.kernels.route import told
from kinseek.poses import pose
from kinseek.proof.branch_and_bound import prove as prove_goal
from kinseek.proof.branch_and_bound import refuse_ranges
from kinseek.proof.certificate import Certificate, Verdict
from kinseek.solvers import Atlas, DivideAndConquer
from kinseek.tolerances import GoalOptions
from kinseek.units import warn_of_angles

from . import report
from .output import complain, held_output, warnings_in_one_line, write_out
from .searches import make_search, searches_in_words, with_search_options
from .words import LENGTHS, gather, joint_values, numbers, size

_EXPORTED = ("divide-and-conquer", "atlas")
"""The searches that can be exported; the first unless another is asked for."""

app = typer.Typer(
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    help="Inverse kinematics of serial robot arms by search. "
    "Exit codes: 0 done or reached, 1 not reached, 2 misuse or output that cannot be written.",
)

ArmName = Annotated[
    str,
    typer.Argument(
        metavar="ARM", help="A bundled arm (see: kinseek robots), or a .urdf, .xacro or MJCF .xml file."
    ),
]
Base = Annotated[str | None, typer.Option(help="Link that stays; the root of the file unless given.")]
Tip = Annotated[str | None, typer.Option(help="Link whose pose is meant; the only leaf unless given.")]
At = Annotated[str | None, typer.Option(metavar="X Y Z", help="Wanted position of the tip in the base, m.")]
Rpy = Annotated[
    str | None, typer.Option(metavar="R P Y", help="Roll, pitch, yaw about fixed x, y, z, as in URDF, rad.")
]
QuatWxyz = Annotated[str | None, typer.Option(metavar="W X Y Z", help="Quaternion, real part first.")]
QuatXyzw = Annotated[str | None, typer.Option(metavar="X Y Z W", help="Quaternion, real part last.")]
Rotvec = Annotated[str | None, typer.Option(metavar="X Y Z", help="Axis times angle, rad.")]
Json = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def run(arguments: Sequence[str]) -> int:
    """Run one command line and return its exit code; a mistake becomes one line on stderr."""
    with held_output() as held, warnings_in_one_line():
        code = _run(arguments)
    return write_out(held.getvalue(), code)


def _run(arguments: Sequence[str]) -> int:
    try:
        words = gather(list(arguments)) or ["--help"]
        return int(app(words, prog_name="kinseek", standalone_mode=False) or 0)
    except typer.Abort:
        return 130
    except Exception as error:
        # Typer's own usage errors have no public base class, but one method in common.
        explain = str if isinstance(error, KinseekError) else getattr(error, "format_message", None)
        if explain is None:
            raise
        complain(explain() if explain is not str else str(error))
        return 2


def _version(wanted: bool) -> None:
    if wanted:
        print(kinseek.__version__)
        raise typer.Exit


@app.callback()
def top(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and stop.")
    ] = False,
) -> None:
    """Hold the options that belong to no command."""


@app.command()
def robots() -> int:
    """List the bundled arms."""
    report.print_robots()
    return 0


@app.command()
def kernels() -> int:
    """Say how the compiled kernels run here: from the library built with the package, or by Numba."""
    print(told())
    return 0


@app.command()
def show(arm: ArmName, base: Base = None, tip: Tip = None) -> int:
    """Show the joints, limits and reach of an arm."""
    report.print_arm(load(arm, base, tip))
    return 0


@app.command()
def fk(
    arm: ArmName,
    q: Annotated[
        list[str] | None, typer.Argument(metavar="Q...", help="One value a joint, base to tip, rad or m.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    deg: Annotated[bool, typer.Option("--deg", help="Angles are in degrees.")] = False,
    json: Json = False,
) -> int:
    """Print the pose of the tip in the base at given joint values."""
    loaded = load(arm, base, tip)
    values = joint_values(loaded, numbers(" ".join(q or []), "fk"), "fk", deg)
    report.print_pose(loaded, values, loaded.fk(values), json)
    return 0


@app.command()
@with_search_options
def solve(
    arm: ArmName,
    at: At = None,
    rpy: Rpy = None,
    quat_wxyz: QuatWxyz = None,
    quat_xyzw: QuatXyzw = None,
    rotvec: Rotvec = None,
    position_only: Annotated[bool, typer.Option("--position-only", help="Any orientation will do.")] = False,
    free: Annotated[
        str | None,
        typer.Option(metavar="AXES", help="Axes whose deviation does not matter, such as rz or z,rx,ry."),
    ] = None,
    frame: Annotated[
        str, typer.Option(help="Whose axes --free names: tool (those of the wanted pose) or base.")
    ] = "tool",
    near: Annotated[
        str | None,
        typer.Option(metavar="Q...", help="Joint values to be near to, or to start from; rad or m."),
    ] = None,
    deg: Annotated[bool, typer.Option("--deg", help="--rpy, --rotvec and --near are in degrees.")] = False,
    base: Base = None,
    tip: Tip = None,
    position_tolerance: Annotated[
        float, typer.Option(help="Largest position error that counts as reached, m.")
    ] = 1e-6,
    orientation_tolerance: Annotated[
        float, typer.Option(help="Largest orientation error that counts as reached, rad.")
    ] = 1e-6,
    position_weight: Annotated[float, typer.Option(help="K_P of the weighted error, per m.")] = 1.0,
    orientation_weight: Annotated[float, typer.Option(help="K_A of the weighted error.")] = 1.0,
    solver: Annotated[
        str | None,
        typer.Option(metavar="NAME", help=searches_in_words()),
    ] = None,
    prove: Annotated[
        bool, typer.Option("--prove", help="Where no answer is found, prove that there is none.")
    ] = False,
    trace: Annotated[bool, typer.Option("--trace", help="Print what the search did, pass by pass.")] = False,
    json: Json = False,
    **search_options: Any,
) -> int:
    """Find joint values that reach a pose. Exit code 0: reached, 1: not reached."""
    loaded = load(arm, base, tip)
    turns = _given({"--rpy": rpy, "--quat-wxyz": quat_wxyz, "--quat-xyzw": quat_xyzw, "--rotvec": rotvec})
    target = _target(at, turns, position_only, deg)
    options: GoalOptions = {
        "position_tolerance": position_tolerance,
        "orientation_tolerance": orientation_tolerance,
        "position_weight": position_weight,
        "orientation_weight": orientation_weight,
    }
    axes = free.replace(",", " ").split() if free is not None else []
    if position_only:
        goal = Goal.position(target[:3, 3], free=axes, **options)
    else:
        goal = Goal.pose(target, free=axes, frame=cast("Frame", frame), **options)
    start = None if near is None else joint_values(loaded, numbers(near, "--near"), "--near", deg)
    search = make_search(solver, search_options)
    clock = time.perf_counter()
    if prove:
        refuse_ranges(goal)
    solution = loaded.ik(goal, near=start, solver=search, trace=trace)
    proof: Certificate | None = None
    if prove:
        proof = prove_goal(solution.problem, answer=solution)
        solution = replace(solution, proved_unreachable=proof.verdict is Verdict.UNREACHABLE)
    report.print_solution(loaded, solution, search, time.perf_counter() - clock, json, proof)
    return 0 if solution.success else 1


@app.command()
@partial(with_search_options, only=_EXPORTED)
def export(
    arm: ArmName,
    to: Annotated[str, typer.Option(metavar="c", help="The language that is written.")],
    folder: Annotated[
        Path | None, typer.Option(help="Where the files go, made unless it is there; ARM_c unless given.")
    ] = None,
    target: Annotated[
        str, typer.Option(metavar="NAME", help=f"The kind of processor: {', '.join(TARGETS)}.")
    ] = "x86-64",
    cpu: Annotated[
        str | None, typer.Option(metavar="NAME", help="One processor of that kind, as LLVM calls it.")
    ] = None,
    form: Annotated[
        str, typer.Option(help="How the kernels are written: object, assembly or llvm (its assembly).")
    ] = "object",
    ram: Annotated[
        str | None, typer.Option(metavar="BYTES", help="What static memory may take: 65536, 64k or 1M.")
    ] = None,
    flash: Annotated[
        str | None, typer.Option(metavar="BYTES", help="What kernels and constants may take.")
    ] = None,
    at: At = None,
    rpy: Rpy = None,
    quat_wxyz: QuatWxyz = None,
    quat_xyzw: QuatXyzw = None,
    rotvec: Rotvec = None,
    solver: Annotated[
        str,
        typer.Option(
            metavar="NAME", help=f"The search: {' or '.join(_EXPORTED)}; the atlas takes 3 to 4 MB of flash."
        ),
    ] = _EXPORTED[0],
    position_only: Annotated[
        bool, typer.Option("--position-only", help="Any orientation will do, now and on the part.")
    ] = False,
    deg: Annotated[bool, typer.Option("--deg", help="--rpy and --rotvec are in degrees.")] = False,
    base: Base = None,
    tip: Tip = None,
    **search_options: Any,
) -> int:
    """Write an arm as C and machine code for a small controller: forward kinematics, and a search.

    The program solves the goal that is given, or a pose that the arm can reach.
    """
    if to != "c":
        raise InvalidExport(suggest(to, ["c"], "language"))
    loaded = load(arm, base, tip)
    goal, turns = (
        None,
        _given({"--rpy": rpy, "--quat-wxyz": quat_wxyz, "--quat-xyzw": quat_xyzw, "--rotvec": rotvec}),
    )
    if at is not None or turns or position_only:
        wanted = _target(at, turns, position_only, deg)
        goal = Goal.position(wanted[:3, 3]) if position_only else Goal.pose(wanted)
    if solver not in _EXPORTED:
        raise InvalidExport(suggest(solver, _EXPORTED, "search for a controller"))
    search = cast("DivideAndConquer | Atlas", make_search(solver, search_options))
    place = checked_folder(
        folder if folder is not None else Path(re.sub(r"[^\w.-]", "_", loaded.name) + "_c")
    )
    parts = prepare(
        loaded,
        target,
        cpu=cpu,
        search=search,
        goal=goal,
        form=form,
        ram=size(ram, "--ram"),
        flash=size(flash, "--flash"),
        notice=complain,
    )
    complain(str(parts))  # Before anything is written, and what goes to stdout waits for the end.
    parts.write(place)
    report.print_parts(place, parts)
    return 0


def _given(options: dict[str, str | None]) -> dict[str, str]:
    return {name: text for name, text in options.items() if text is not None}


def _target(at: str | None, turns: dict[str, str], position_only: bool, deg: bool) -> NDArray[np.float64]:
    """Read the wanted pose, (4, 4).

    Raises:
        InvalidGoal: No position, no rotation, or more than one.
    """
    if at is None:
        raise InvalidGoal("a goal needs --at X Y Z, the wanted position in metres")
    chosen = [*turns, *(["--position-only"] if position_only else [])]
    if len(chosen) != 1:
        options = "--rpy, --quat-wxyz, --quat-xyzw, --rotvec or --position-only"
        raise InvalidGoal(f"a goal needs exactly one of {options}; got {' and '.join(chosen) or 'none'}")
    position = numbers(at, "--at", LENGTHS["--at"])
    turn: dict[str, Any] = {}
    for option, text in turns.items():
        values = np.array(numbers(text, option, LENGTHS[option]))
        name = option[2:].replace("-", "_")
        turn[name] = np.deg2rad(values) if deg and name in ("rpy", "rotvec") else values
        if name in ("rpy", "rotvec") and not deg:
            warn_of_angles(values, f"{option} {text}", "add --deg", 1)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UnitWarning)  # Said above, in the words of a command line.
        return pose(position, **turn)
