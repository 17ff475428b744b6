"""Errors for arguments that a call does not have: they name kinseek's argument for words of other libraries.

A public function takes ``**unknown: Never`` and begins with ``if unknown: raise unknown_argument(function, unknown)``. Type
checkers thus reject such a call, and at run time it costs some 30 ns.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from .errors import InvalidUse, near_names

_SAME = "kinseek calls it"


class _Words(NamedTuple):
    """Words that mean the same, and what kinseek has for it."""

    words: str
    """The words of others, separated by spaces, in lower case and without underscores."""
    ours: tuple[str, ...]
    """Arguments of kinseek. A message names those that the call has, or else where they belong."""
    link: str = _SAME
    """What is said before them."""


_FOREIGN = (
    # TRAC-IK, ikpy, Robotics Toolbox, MoveIt, pinocchio, Pink, OptIK, PyBullet, cuRobo, pytorch_kinematics.
    _Words(
        "seed seedstate ikseedstate qinit q0 qstart x0 init initial initialq initialposition initialguess guess "
        "initialconfiguration initialjoints current currentq currentposition currentpositions currentjoints restpose "
        "restposes retractconfig nominal reference cfg configuration",
        ("near", "start", "q0"),
    ),
    _Words("target goalq qend qgoal finalposition", ("end",)),
    _Words(
        "timeout maxtime timebudget deadline timelimit allowedplanningtime maxplanningtime", ("time_limit",)
    ),
    _Words(
        "maxiterations maxiter iterations iters ilimit itmax maxnumiterations attempts numattempts slimit maxrestarts "
        "restarts numseeds numretries nretries trials maxattempts",
        ("time_limit", "budget"),
        "kinseek counts no iterations or restarts; limit the work by",
    ),
    _Words(
        "tol tolerance eps epsilon precision accuracy residualthreshold tolf threshold",
        ("position_tolerance", "orientation_tolerance"),
    ),
    _Words("postol positiontol positionthreshold postolerance", ("position_tolerance",)),
    _Words(
        "rottol rotationthreshold orientationtol rotationtolerance rottolerance", ("orientation_tolerance",)
    ),
    _Words(
        "mask we bounds orientationmode dims maskcartesian",
        ("free", "box"),
        "kinseek names the axes that may deviate:",
    ),
    _Words("linearweight positioncost poscost", ("position_weight",)),
    _Words("angularweight orientationcost rotcost", ("orientation_weight",)),
    _Words("solvetype solutionmode redundancy posture elbow shoulder wrist armangle sew", ("prefer",)),
    _Words("avoidcollisions collision collisions collisioncheck checkcollision planningscene", ("scene",)),
    _Words("margin safetymargin collisionmargin padding", ("clearance",)),
    _Words("callback solutioncallback constraintfn isvalid validity filter gsvcf", ("valid",)),
    _Words("objective costfunction costfn secondaryobjective", ("cost",)),
    _Words("njobs jobs workers numthreads nthreads parallel parallelthreads cores numworkers", ("threads",)),
    _Words("tqdm verbose showprogress", ("progress",)),
    _Words("maxsolutions nsolutions numsolutions returnnumbers", ("count",)),
    _Words("all allsolutions returnall", ("branches",), "all solutions come from"),
    _Words("consistencylimits maxdistance consistency", ("valid",), "with near=, write it as a condition:"),
    _Words(
        "ee eelink eename eelinkname endeffector endeffectorlink end tiplink tiplinkname tipname targetlink "
        "targetlinkname endlink iklinkname linkname",
        ("tip",),
    ),
    _Words("baselink baselinkname baseelements root rootlink baseframe frameid", ("base",)),
    _Words("tcp tooloffset eeoffset toolframe tooltransform lastlinkvector offset", ("tool",)),
    _Words(
        "quat quaternion orientation quaternions",
        ("quat_wxyz", "quat_xyzw"),
        "the name says the order of a quaternion:",
    ),
    _Words("wxyz quatwxyz targetwxyz", ("quat_wxyz",)),
    _Words("xyzw quatxyzw", ("quat_xyzw",)),
    _Words("r rot matrix rotmat rotationmatrix dcm so3 targetorientation", ("rotation",)),
    _Words("euler eulerangles eulerxyz rollpitchyaw eul xyzrpy angles", ("rpy",)),
    _Words("axisangle angleaxis rvec rotationvector", ("rotvec",)),
    _Words("deg degree unit units indegrees", ("degrees",)),
    _Words("p xyz pos translation t targetposition", ("position",)),
    _Words("normal z approach zaxis", ("z_axis",)),
    _Words("tangent x xaxis", ("x_axis",)),
    _Words(
        "maxvelocity velocitylimits vellimits qdlim qdmax speed maxspeed speeds vmax velocities",
        ("velocity",),
    ),
    _Words(
        "jumpthreshold maxjump jump revolutejumpthreshold prismaticjumpthreshold maxjointstep", ("max_step",)
    ),
    _Words("eefstep maxeefstep resolution", ("step",)),
    _Words("dt timestep cycle cycletime ts", ("period",)),
    _Words("time timestamps stamps", ("times",)),
    _Words("mappings xacroargs xacroarguments arguments", ("args",)),
    _Words("packagedirs packagepaths packagedir packagemap meshdir", ("packages",)),
    _Words(
        "jointlimits limits lowerlimits upperlimits qlim lowerbound upperbound", ("limits", "with_limits")
    ),
    _Words("activejoints activelinksmask activedofs lockedjoints locked", ("with_locked",)),
    _Words(
        "damping jointdamping lmdamping gain alpha stepsize learningrate lr optimizer regularization "
        "regularizationparameter pinv method kq km",
        (),
        "kinseek's search has no such setting",
    ),
)

_PLACES = {
    "near": "arm.ik(T, near=…)",
    "start": "arm.follow(poses, start=…)",
    "end": "arm.follow(poses, end=…)",
    "q0": "arm.track(q0)",
    "time_limit": "arm.ik(T, time_limit=…)",
    "budget": "arm.prove(T, budget=…)",
    "position_tolerance": "kinseek.Goal.pose(T, position_tolerance=…)",
    "orientation_tolerance": "kinseek.Goal.pose(T, orientation_tolerance=…)",
    "position_weight": "kinseek.Goal.pose(T, position_weight=…)",
    "orientation_weight": "kinseek.Goal.pose(T, orientation_weight=…)",
    "free": 'kinseek.Goal.pose(T, free="rz")',
    "box": 'kinseek.Goal.pose(T, box={"z": (-0.01, 0.01)})',
    "cone": 'kinseek.Goal.pose(T, free="rz", cone=…)',
    "frame": "kinseek.Goal.pose(T, frame=…)",
    "tool_axis": "kinseek.Goal.pointing(position, direction, tool_axis)",
    "tool": "kinseek.Goal.pose(T, tool=…)",
    "prefer": "arm.ik(T, prefer=…)",
    "order": "arm.branches(T, order=…)",
    "scene": "arm.ik(T, scene=…)",
    "clearance": "arm.ik(T, scene=…, clearance=…)",
    "valid": "arm.ik(T, valid=…)",
    "cost": "arm.ik(T, cost=…)",
    "threads": "arm.ik(T, threads=…)",
    "progress": "arm.ik(T, progress=True)",
    "solver": "arm.ik(T, solver=…)",
    "prove": "arm.ik(T, prove=True)",
    "trace": "arm.ik(T, trace=True)",
    "bad": 'arm.ik(T, bad="skip")',
    "count": "arm.branches(T, count=…)",
    "copies": "arm.branches(T, copies=True)",
    "branches": "arm.branches(T)",
    "tip": "kinseek.load(file, tip=…)",
    "base": "kinseek.load(file, base=…)",
    "args": "kinseek.load(file, args=…)",
    "packages": "kinseek.load(file, packages=…)",
    "limits": "kinseek.load(file, limits=…)",
    "position": "kinseek.pose(position)",
    **{
        name: f"kinseek.pose(p, {name}=…)" for name in ("quat_wxyz", "quat_xyzw", "rpy", "rotvec", "rotation")
    },
    "degrees": "kinseek.pose(p, rpy=…, degrees=True)",
    "repair": "kinseek.pose(p, rotation=…, repair=True)",
    "z_axis": "kinseek.pose(p, z_axis=…, x_axis=…)",
    "x_axis": "kinseek.pose(p, z_axis=…, x_axis=…)",
    "velocity": "arm.follow(poses, velocity=…)",
    "max_step": "arm.follow(poses, max_step=…)",
    "times": "arm.follow(poses, times=…)",
    "period": "arm.track(q0, period=…)",
    "step": "kinseek.interpolate(poses, step=…)",
    "with_limits": "arm.with_limits({joint: (lower, upper)})",
    "with_locked": "arm.with_locked({joint: value})",
}
"""Where an argument of kinseek belongs, for calls that do not have it."""


def unknown_argument(
    function: Callable[..., Any], unknown: Iterable[str], options: Iterable[str] = ()
) -> InvalidUse:
    """Return the error for keyword arguments that a function does not have.

    Args:
        function: The public function or method.
        unknown: The names that were given.
        options: Valid names that its signature hides behind a TypedDict.
    """
    taken = inspect.signature(function).parameters.values()
    named = (inspect.Parameter.POSITIONAL_OR_KEYWORD, inspect.Parameter.KEYWORD_ONLY)
    valid = [one.name for one in taken if one.kind in named and one.name != "self"] + list(options)
    door = f"{function.__qualname__.removeprefix('Arm.').removeprefix('ForwardArm.')}()"
    said = [f"{door} has no argument {name!r}{_hint(name, valid)}" for name in unknown]
    ends = ["" if one.endswith("?") else "." for one in said]
    sentences = " ".join(one + end for one, end in zip(said, ends, strict=True))
    return InvalidUse(f"{sentences} Valid: {', '.join(f'{name}=' for name in valid)}")


def _hint(name: str, valid: list[str]) -> str:
    """Return what kinseek has in place of an argument, for the end of a sentence."""
    folded = name.replace("_", "").lower()
    group = next((group for group in _FOREIGN if folded in group.words.split()), None)
    if group is not None and (here := [f"{one}=" for one in group.ours if one in valid]):
        return f"; {group.link} {' or '.join(here)}"
    if name in _PLACES:
        return f"; it belongs to {_PLACES[name]}"
    if group is not None:
        link = "kinseek has it as" if group.link == _SAME else group.link
        return f"; {link} {' or '.join(_PLACES[one] for one in group.ours[:2])}".rstrip()
    near = near_names(name, valid)
    return f"; did you mean {' or '.join(f'{one}=' for one in near)}?" if near else ""
