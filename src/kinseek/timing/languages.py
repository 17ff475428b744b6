"""Programs in the languages of robots' controllers: a template for each language, and the function that fills it in.

None of these programs was run on a controller. The syntax follows the manufacturers' public descriptions: Universal Robots,
*The URScript Programming Language* (servoj, movej, movel, stopj); KUKA, *Quickguide KRL-Syntax, KSS 8.x* (PTP_SPLINE, SPTP,
TIME_BLOCK); ABB, *RAPID Instructions, Functions and Data types* (MoveAbsJ, jointtarget).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem, InvalidUse, suggest
from kinseek.printable import printable
from kinseek.robots.mechanism import PRISMATIC, Mechanism

Array = NDArray[np.float64]

_LONGEST_COMMENT = 100
"""Maximum length of a name in a comment, so that no line becomes too long for a controller."""
_SLOWEST = 1e-3
"""Least speed of a move, also of one that goes nowhere: 0 is an error on controllers [rad/s] or [m/s]."""
_SOFTEST, _DEFAULT_ACCELERATION = 1e-2, 1.4
"""Least acceleration of a move, and that of joints without a limit, which is URScript's default [rad/s²] or [m/s²]."""


@dataclass(frozen=True, kw_only=True)
class Language:
    """The template of a program, with which `Trajectory.save` writes a file for a robot's controller.

    `header`, `line`, `last` and `footer` are texts for `str.format`; literal braces are doubled. The header is filled in
    with the first point of the motion, `line` with each further one, `last` instead of `line` with the last one, and the
    footer with the last one again. Angles and lengths have the units of the language. The fields are:

    - `name`: name of the program.
    - `comments`: comments with the name of the arm and the joint of each axis.
    - `axes`, `external`, `values`: values of the robot's axes, of the external axes, and of both, as texts.
    - `number`, `count`: index of the point, from 0, and the number of points.
    - `time`, `duration`, `total`: time since the beginning, since the point before, and of the whole motion [s].
    - `share`: `duration` in percent of `total`.
    - `velocity`: mean speed, since the point before, of the joint that moves farthest.
    - `acceleration`: the largest one of this joint at which no joint exceeds its limit if all move straight to the point.
    - `tip_velocity`: mean speed of the tip on a straight line from the point before [m/s].
    - `tip_acceleration`: the largest change of these speeds in the whole motion [m/s²].
    - `blend`: radius around the point, at most half of the distance to the points beside it; 0 at both ends.
    """

    axes: tuple[str, ...]
    """Names of the robot's axes, in order. Joints that turn are assigned to them in order."""
    external: tuple[str, ...] = ()
    """Names of the external axes, in order. Prismatic joints before or after the others are assigned to them in order."""
    only_turning: bool = False
    """Whether each of the robot's axes must be a joint that turns."""
    header: str
    """Lines before the motion, filled in with its first point."""
    line: str
    """Lines for a point."""
    last: str = ""
    """Lines for the last point; empty if they are as for the others."""
    footer: str
    """Lines after the motion, filled in with its last point."""
    axis: str = "{value}"
    """Text for the value of one axis, with the fields `name` and `value`."""
    unused_axis: str | None = None
    """Text for a robot's axis without a joint; "" leaves it out, and None makes it an error."""
    unused_external: str = ""
    """Text for an external axis without a joint; "" leaves it out."""
    comment: str
    """Beginning of a comment, which ends with the line."""
    reserved: str = ""
    """Words of the language besides those of the texts, which no program can be called."""
    newline: str = "\n"
    """End of a line."""
    degrees: bool = False
    """Whether angles are in degrees."""
    millimetres: bool = False
    """Whether lengths are in millimetres."""
    decimals: int = 12
    """Digits after the decimal point of joint values."""
    longest_name: int = 24
    """Maximum length of the name of a program."""
    needs_period: bool = False
    """Whether the points must be equally spaced in time."""


_UR = ("J1", "J2", "J3", "J4", "J5", "J6")
_UR_WORDS = (
    "and break continue def elif else end enter_critical exit_critical false global halt if join kill local not or return "
    "run sec sync thread true while xor"
)
_KRL_WORDS = (
    "and anin anout axis b_and b_exor b_not b_or bool brake case cast_from cast_to char circ circ_rel confirm const "
    "continue decl def defdat deffct delay digin distance do e6axis e6pos else end enddat endfct endfor endif endloop "
    "endswitch endwhile enum exit ext extfct false for frame global goto halt if import int interrupt is lin lin_rel loop "
    "maximum minimum not off on or pos prio ptp ptp_rel public pulse real repeat resume return sec signal struc switch "
    "then to trigger true until wait when while"
)
_RAPID_WORDS = (
    "alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc endrecord "
    "endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or pers "
    "proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while "
    "with xor"
)
_UR_HEADER = "def {name}():\n{comments}\n  movej([{axes}], a=0.5, v=0.25)\n"

SERVOJ = Language(
    axes=_UR,
    only_turning=True,
    header=_UR_HEADER,
    line="  servoj([{axes}], 0, 0, {duration:.6f}, 0.1, 300)\n",
    # The arm follows with a delay, so the last point is held before the arm stops.
    footer="  servoj([{axes}], 0, 0, 0.5, 0.1, 300)\n  stopj(2)\nend\n",
    comment="  #",
    reserved=_UR_WORDS,
    needs_period=True,
)
"""URScript: a stream of `servoj`, one for each period. `lookahead_time` and `gain` are the defaults, 0.1 s and 300."""

MOVEJ = Language(
    axes=_UR,
    only_turning=True,
    header=_UR_HEADER,
    line="  movej([{axes}], a={acceleration:.6f}, v={velocity:.6f}, r={blend:.6f})\n",
    footer="end\n",
    comment="  #",
    reserved=_UR_WORDS,
)
"""URScript: straight motions of the joints with blends. The controller plans the time."""

MOVEL = replace(
    MOVEJ,
    # The controller computes the poses from joint values, so neither its base nor its tool has to be the arm's.
    line="  movel([{axes}], a={tip_acceleration:.6f}, v={tip_velocity:.6f}, r={blend:.6f})\n",
)
"""URScript: straight motions of the tool with blends. The controller plans the time."""

KRL = Language(
    axes=("A1", "A2", "A3", "A4", "A5", "A6"),
    external=("E1", "E2", "E3", "E4", "E5", "E6"),
    header="""\
&ACCESS RVP
DEF {name}()
{comments}
BAS(#INITMOV, 0)
BAS(#VEL_PTP, 10)
PTP {{{values}}}
BAS(#VEL_PTP, 100)
PTP_SPLINE
  TIME_BLOCK START
""",
    line="  SPTP {{{values}}}\n  TIME_BLOCK PART = {share:.9f}\n",
    footer="  TIME_BLOCK END = {total:.6f}\nENDSPLINE\nEND\n",
    axis="{name} {value}",
    unused_axis="",
    comment=";",
    reserved=_KRL_WORDS,
    newline="\r\n",
    degrees=True,
    millimetres=True,
    decimals=9,
)
"""KRL of KUKA: a spline through all points, with the share of each in the total time."""

RAPID = Language(
    axes=("rax_1", "rax_2", "rax_3", "rax_4", "rax_5", "rax_6"),
    external=("eax_a", "eax_b", "eax_c", "eax_d", "eax_e", "eax_f"),
    header="""\
MODULE {name}
{comments}
  PROC move_{name}()
    MoveAbsJ [[{axes}], [{external}]]\\NoEOffs, v50, fine, tool0;
""",
    line="    MoveAbsJ [[{axes}], [{external}]]\\NoEOffs, v1000\\T:={duration:.6f}, z0\\Z:={blend:.6f}, tool0;\n",
    last="    MoveAbsJ [[{axes}], [{external}]]\\NoEOffs, v1000\\T:={duration:.6f}, fine, tool0;\n",
    footer="  ENDPROC\nENDMODULE\n",
    unused_axis="0",
    unused_external="9E9",
    comment="  !",
    reserved=_RAPID_WORDS,
    newline="\r\n",
    degrees=True,
    millimetres=True,
    decimals=9,
    longest_name=27,  # 32, less those before it in the name of the procedure.
)
"""RAPID of ABB: a move with its time to each point, and a corner path around it."""


class Motion(NamedTuple):
    """Points of a motion in order, k of them."""

    times: Array
    """Time of each point, increasing, (k,) [s]."""
    q: Array
    """Joint values, (k, n), [rad] or [m]."""
    tip: Array
    """Positions of the tip, or of the tool, (k, 3) [m]."""


def program(
    mechanism: Mechanism,
    motion: Motion,
    language: Language,
    name: str,
    *,
    acceleration: Array,
    blend: float,
    axes: Mapping[str, str] | None,
) -> str:
    """Return a program that moves a robot through the points of a motion.

    Args:
        mechanism: The arm.
        motion: The points.
        language: The template.
        name: Name of the program.
        acceleration: Largest acceleration of each joint, (n,), [rad/s²] or [m/s²]; infinite if there is none.
        blend: Largest radius around a point in which the motion may leave it aside [m].
        axes: Name of the axis of each joint, by joint; None assigns them in order.

    Raises:
        InvalidProblem: The name is no identifier, the axes of the language cannot be the joints of the arm, or the motion
            takes no time.
        InvalidUse: A text of the template has a field that does not exist.
    """
    require_name(name, language)
    joint_of = assigned(mechanism, language, axes)
    scale = _units(mechanism, language)
    count, total = len(motion.times), float(motion.times[-1])
    if total <= 0.0:
        raise InvalidProblem("a program needs a motion, and this trajectory takes no time")
    comments = _comments(mechanism, joint_of, language, f"{count} points, {total:.6g} s")
    fields = {
        "time": motion.times,
        "duration": np.diff(motion.times, prepend=0.0),
        "share": 100.0 * np.diff(motion.times, prepend=0.0) / total,
        **_moves(motion, scale, acceleration, language, blend),
    }
    columns = {field: values.tolist() for field, values in fields.items()}
    values = np.round(motion.q * scale, language.decimals) + 0.0  # No "-0".
    texts = []
    for i, row in enumerate(values):
        own = _texts(row, language.axes, language.unused_axis, joint_of, language)
        external = _texts(row, language.external, language.unused_external, joint_of, language)
        point = {
            "name": name,
            "comments": comments,
            "axes": ", ".join(own),
            "external": ", ".join(external),
            "values": ", ".join([*own, *external]),
            "number": i,
            "count": count,
            "total": total,
            **{field: column[i] for field, column in columns.items()},
        }
        is_last = i == count - 1
        line = language.header if i == 0 else language.last if is_last and language.last else language.line
        texts.append(_filled(line, point))
        if is_last:
            texts.append(_filled(language.footer, point))
    return "".join(texts).replace("\n", language.newline)


def require_name(name: str, language: Language) -> None:
    """Check that a program can have a name: it is an identifier, and nothing in the program is called so.

    Raises:
        InvalidProblem: It cannot.
    """
    if (
        not isinstance(name, str)
        or not re.fullmatch("[A-Za-z][A-Za-z0-9_]*", name)
        or len(name) > language.longest_name
    ):
        raise InvalidProblem(
            f"a program cannot be called {name!r:.200}: expected a letter, then letters, digits and underscores, at most "
            f"{language.longest_name} in all. The name is that of the file, or give name="
        )
    template = re.sub("{[^{}]*}", " ", language.header + language.line + language.last + language.footer)
    if name.lower() in re.findall("[a-z][a-z0-9_]+", f"{template} {language.reserved}".lower()):
        raise InvalidProblem(
            f"a program cannot be called {name!r}, which is a word of its language; name the file otherwise, or give name="
        )


def assigned(mechanism: Mechanism, language: Language, axes: Mapping[str, str] | None) -> dict[str, int]:
    """Return the index of the joint of each axis, by axis.

    Raises:
        InvalidProblem: The axes cannot be these joints.
    """
    names, kinds = mechanism.joint_names, mechanism.kinds
    if others := [f"{name!r} ({kind})" for name, kind in zip(names, kinds, strict=True) if not _unit(kind)]:
        raise InvalidProblem(
            f"a program needs joints with a unit, revolute, continuous or prismatic; got {', '.join(others[:8])}"
        )
    if axes is not None and not isinstance(axes, Mapping):
        raise InvalidProblem(f"axes must be a dict, {{joint: axis}}, got {axes!r:.200}")
    sought = _in_order(mechanism, language) if axes is None else dict(axes)
    valid = (*language.axes, *language.external)
    for joint, axis in sought.items():
        if joint not in names:
            raise InvalidProblem(f"axes: {suggest(str(joint), names, 'joint')}")
        if not isinstance(axis, str) or axis not in valid:
            raise InvalidProblem(f"axes: {suggest(str(axis), valid, 'axis')}")
    joint_of = {axis: names.index(joint) for joint, axis in sought.items()}
    if missing := [name for name in names if name not in sought]:
        raise InvalidProblem(f"axes has no axis for the joints {', '.join(missing[:8])}")
    if len(joint_of) < len(sought):
        raise InvalidProblem(f"axes has the same axis for two joints: {', '.join(sought.values())}")
    if language.unused_axis is None and (unused := [axis for axis in language.axes if axis not in joint_of]):
        raise InvalidProblem(_misfit(mechanism, language, f"no joint is left for {', '.join(unused)}"))
    used = [axis for axis in language.axes if axis in joint_of]
    sliding = [axis for axis in used if kinds[joint_of[axis]] == PRISMATIC]
    if language.only_turning and sliding:
        raise InvalidProblem(_misfit(mechanism, language, f"{', '.join(sliding)} would be prismatic"))
    return joint_of


def _in_order(mechanism: Mechanism, language: Language) -> dict[str, str]:
    """Return the axis of each joint: those that turn are axes of the robot, and prismatic ones around them are external."""
    sliding = [kind == PRISMATIC for kind in mechanism.kinds]
    turning = [i for i, slides in enumerate(sliding) if not slides]
    if len(turning) > len(language.axes) or sum(sliding) > len(language.external):
        raise InvalidProblem(_misfit(mechanism, language, "there are too many joints"))
    if turning and any(sliding[turning[0] : turning[-1]]):
        raise InvalidProblem(
            _misfit(
                mechanism,
                language,
                "a prismatic joint is between others; give axes={joint: axis} for all joints",
            )
        )
    own, external = iter(language.axes), iter(language.external)
    return {
        name: next(external if slides else own)
        for name, slides in zip(mechanism.joint_names, sliding, strict=True)
    }


def _misfit(mechanism: Mechanism, language: Language, why: str) -> str:
    """Return the message of an arm that the axes of a language do not fit."""
    exactly = "exactly" if language.unused_axis is None else "at most"
    turning = " that turn" if language.only_turning else ""
    external = f" and {len(language.external)} external ones" if language.external else ""
    joints = ", ".join(
        f"{name} ({kind})" for name, kind in zip(mechanism.joint_names, mechanism.kinds, strict=True)
    )
    return (
        f"the program has {exactly} {len(language.axes)} axes{turning}{external}, and the joints of the arm are "
        f"{joints:.500}: {why}"
    )


def _unit(kind: str) -> bool:
    """Return whether the values of a joint of this kind have a unit."""
    return kind in ("revolute", "continuous", PRISMATIC)


def _units(mechanism: Mechanism, language: Language) -> Array:
    """Return the factor from our unit of each joint to that of a language, (n,)."""
    angle, length = np.rad2deg(1.0) if language.degrees else 1.0, 1e3 if language.millimetres else 1.0
    return np.array([length if kind == PRISMATIC else angle for kind in mechanism.kinds])


def _comments(mechanism: Mechanism, joint_of: Mapping[str, int], language: Language, size: str) -> str:
    """Return comments with the names of the arm and its joints, of which no character can end the comment."""
    said = [f"kinseek: {_in_comment(mechanism.name)}, {size}"]
    said += [f"{axis}: {_in_comment(mechanism.joint_names[j])}" for axis, j in joint_of.items()]
    return "\n".join(f"{language.comment} {each}" for each in said)


def _in_comment(name: str) -> str:
    """Return a name from a file with printable ASCII characters alone; others are escaped."""
    return printable(name).encode("ascii", "backslashreplace").decode()[:_LONGEST_COMMENT]


def _texts(
    row: Array, axes: Sequence[str], unused: str | None, joint_of: Mapping[str, int], language: Language
) -> list[str]:
    """Return the texts of the values of some axes; `unused` is that of an axis without a joint."""
    texts = [
        _filled(language.axis, {"name": axis, "value": f"{row[joint_of[axis]]:.{language.decimals}f}"})
        if axis in joint_of
        else unused
        for axis in axes
    ]
    return [text for text in texts if text]


def _moves(
    motion: Motion,
    scale: Array,
    acceleration: Array,
    language: Language,
    blend: float,
) -> dict[str, Array]:
    """Return speeds, accelerations and blends of the moves to each point, (k,) each, in the units of a language.

    The move to the first point is none.
    """
    durations = np.diff(motion.times)
    steps = np.abs(np.diff(motion.q, axis=0))
    farthest = steps.argmax(axis=1)
    leading = steps.max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        # On a straight way joint j moves steps[j] / leading as fast as the leading one.
        most = np.where(steps > 0.0, acceleration * leading[:, None] / steps, np.inf).min(axis=1)
    most = np.where(np.isfinite(most), np.maximum(most, _SOFTEST), _DEFAULT_ACCELERATION)
    distances = np.linalg.norm(np.diff(motion.tip, axis=0), axis=1)
    tip = distances / durations
    # From rest to the mean speed of the first move within half of its time, and so on.
    changes = np.abs(np.diff(tip, prepend=0.0, append=0.0))
    between = 0.5 * (np.append(durations, 0.0) + np.append(0.0, durations))
    length = 1e3 if language.millimetres else 1.0
    radii = np.minimum(blend, 0.5 * np.minimum(distances[:-1], distances[1:]))
    radii = np.concatenate([[0.0], np.floor(radii * length * 1e6) / 1e6, [0.0]])
    return {
        "velocity": np.append(0.0, np.maximum(leading / durations, _SLOWEST) * scale[farthest]),
        "acceleration": np.append(0.0, most * scale[farthest]),
        "tip_velocity": np.append(0.0, np.maximum(tip, _SLOWEST) * length),
        "tip_acceleration": np.full(
            len(motion.times), max(float((changes / between).max()), _SOFTEST) * length
        ),
        "blend": radii,
    }


def _filled(text: str, fields: Mapping[str, object]) -> str:
    try:
        return text.format_map(fields)
    except KeyError as error:
        raise InvalidUse(f"template {text!r:.200}: {suggest(str(error.args[0]), fields, 'field')}") from None
    except (ValueError, IndexError, AttributeError) as error:
        raise InvalidUse(f"template {text!r:.200}: {error}; literal braces are doubled") from None
