"""Export of a tracker: a step towards a pose in each period, within limits, without the samples of an atlas."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from kinseek.arm import Arm
from kinseek.errors import InvalidExport
from kinseek.goal import Goal
from kinseek.kernels.atlas.memory import LAYOUT
from kinseek.kernels.atlas.task import ROWS
from kinseek.kernels.entry import ENTRIES
from kinseek.kernels.paths.limited import GO, POSITION, Motion
from kinseek.kernels.paths.servo import NO_POSE, State
from kinseek.kernels.pointers import ROW
from kinseek.paths.past import TIMES
from kinseek.paths.tracker import AT_REST, Tracker
from kinseek.problem import Problem

from .c_text import array, guarded, number
from .design import Design, room_for

Array = NDArray[np.float64]

READ = ("lower", "upper", "columns", "numbers", "lengths", "links")
"""What the kernels of a tracker read of the handle of a task, besides the chain. The other rows are empty."""

LIMITS = ("lower", "upper", "velocity_limit", "acceleration_limit", "jerk_limit")
"""Constants of the joints' motion."""

VARIED = len(State._fields) - 2 + len(Motion._fields) - len(LIMITS)
"""Arrays of n numbers that change: of the states of the two layers."""

STEPS, TRACKED = 1000, 750
"""Steps of the program: so many follow a pose, and the rest brake."""

SWING = 0.2
"""Largest motion of a joint for the pose that the program tracks [rad] or [m]."""


def tracker_goal(tracker: Tracker) -> Goal:
    """Return the goal whose target every step replaces, at the pose where the joints are."""
    goal = tracker._goal.given
    return goal.at(tracker._goal.pose_at(tracker.q))


def tracker_design(tracker: Tracker, problem: Problem, ram: int | None) -> Design:
    """Return the design of a tracker.

    Raises:
        InvalidExport: A tracker of another arm, with a scene or a preference, or too little memory.
    """
    arm = problem.mechanism
    if tracker._mechanism is not arm:
        raise InvalidExport(
            f"the tracker is one of another arm, {tracker._mechanism.name!r}; expected Arm.track of {arm.name!r} itself"
        )
    if tracker._joints._around.scene is not None:
        raise InvalidExport("an exported tracker has no scene: give Arm.track none")
    if tracker._drift is not None:
        raise InvalidExport("an exported tracker has no preference: give Arm.track no prefer=")
    index, motion, dof = tracker._goal.index, tracker._joints.motion, arm.dof
    joints = len(index.arrays.leader)
    names = {ROWS.first["chain"] + k: f"chain_{name}" for k, name in enumerate(index.arrays._fields)}
    names |= {ROWS.first[name]: f"task_{name}" for name in READ}
    own = {f"task_{name}": index._arrays[ROWS.first[name]] for name in READ}
    own |= {f"limit_{name}": getattr(motion, name) for name in LIMITS}
    own["tolerances"] = tracker._goal.tolerances
    lines = [array(name, each, infinite=True) for name, each in own.items()]
    lines += [
        "/* The arrays that the kernels read, with their lengths. A search would also read the samples of an atlas. */",
        "static const struct {\n    const void *first;\n    int32_t shape[3];\n} rows[] = {",
    ]
    for row, each in enumerate(index._arrays):
        shape = ", ".join(map(str, (*each.shape, *(1,) * (ROW - 1 - each.ndim))))
        lines.append(f"    {{{names[row]}, {{{shape}}}}}," if row in names else "    {0, {0, 0, 0}},")
    lines.append("};")
    memory = LAYOUT.count.of(dof=dof, joints=joints)
    # What `minimise` allocates.
    room = room_for(12, dof, dof * dof, 6 * joints, 3 * joints, 3 * dof, dof * dof, dof, dof, dof)
    taken = room + 8 * (memory + ROW * len(index._arrays) + VARIED * dof + 2)
    if ram is not None and taken > ram:
        raise InvalidExport(
            f"{arm.name!r} with {dof} joints needs {taken:,} bytes of RAM for the tracker, got {ram:,}"
        )
    return Design(
        folder="tracker",
        entries=(ENTRIES["ks_track_step"], ENTRIES["ks_limited_step"]),
        routines=(),
        numbers={
            "TRACKER": "1 /* Instead of a search. */",
            "PERIOD": f"{tracker.period!r} /* Period for which it was made [s]; each step takes its own time. */",
            "ROWS": len(index._arrays),
            "MEMORY": f"{memory} /* Numbers of 8 bytes that a step works on. */",
            "SHORTEST": f"{TIMES[0]!r} /* Bounds of the duration of a step [s]. */",
            "LONGEST": repr(TIMES[1]),
            "LOOSE": f"{NO_POSE} /* Results and arguments of the kernels. */",
            "AT_POSITION": POSITION,
            "AT_REST": f"{AT_REST!r} /* Below this velocity a joint has arrived at its limit [rad/s or m/s]. */",
            "GO": GO,
            "POSITION_TOLERANCE": f"{number(tracker._goal.given.position_tolerance)} /* [m] */",
            "ORIENTATION_TOLERANCE": f"{number(tracker._goal.given.orientation_tolerance)} /* [rad] */",
        },
        chain=index.arrays,
        axis_weights=problem.goal.arrays.axis_weights,
        texts={"rows.h": guarded("KINSEEK_ROWS_H", ["#include <math.h>", '#include "constants.h"', *lines])},
        data={},
        constants=sum(each.nbytes for each in own.values()) + 16 * len(index._arrays),
        room=room,
        ram=taken,
        source="track.c",
    )


def tracking(arm: Arm, tracker: Tracker) -> list[str]:
    """Return what the program does, and the result of kinseek, in C.

    The pose to track is that of joints that swing from where they are and back; the arm can therefore reach it.
    """
    start = tracker.q
    here = np.clip(start, arm.lower, arm.upper)
    # Towards the limit that is farther away.
    below, above = here - arm.lower, arm.upper - here
    swing = np.where(above >= below, np.minimum(0.5 * above, SWING), -np.minimum(0.5 * below, SWING))
    rate = 2.0 * math.pi / STEPS
    # Only limits of the arm itself may be infinite, and they are the default.
    velocity, acceleration, jerk = (
        each if np.isfinite(each).all() else None
        for each in (tracker.velocity, tracker.acceleration, tracker.jerk)
    )
    limits = velocity, acceleration, jerk
    copy = Tracker(arm.mechanism, start, tracker.period, limits, recover=False, goal=tracker._goal.given)
    for k in range(TRACKED):
        copy.step(arm.fk(here + swing * (0.5 - 0.5 * math.cos(rate * (k + 1)))))
    tracked = copy.q
    for _ in range(STEPS - TRACKED):
        copy.step()
    return [
        f"#define STEPS {STEPS}",
        f"#define TRACKED {TRACKED}",
        f"#define RATE {number(rate)} /* [rad] of the swing in each step */",
        array("start_q", start),
        "/* The joints swing from here by so much: their pose is what is tracked. */",
        array("swing_from", here),
        array("swing_by", swing),
        "/* The results of kinseek on the exporting machine: after tracking, and at the end. */",
        array("expected_q", tracked),
        array("expected_rest", copy.q),
    ]
