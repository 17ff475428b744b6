"""Trajectories in the forms that other programs and robots take: tables, ROS messages, programs of controllers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from kinseek.errors import InvalidProblem, InvalidUse, suggest
from kinseek.robots.mechanism import Mechanism
from kinseek.support.validation import as_number
from kinseek.support.whole_file import output_path, whole_file
from kinseek.tables import TABLE_ENDINGS, Table, import_pyarrow, write_table

from .languages import (
    KRL,
    MOVEJ,
    MOVEL,
    RAPID,
    SERVOJ,
    Language,
    Motion,
    assigned,
    program,
    require_name,
)
from .trajectory import SAME_TIME, Samples, Trajectory

Array = NDArray[np.float64]

LANGUAGES = {"servoj": SERVOJ, "movej": MOVEJ, "movel": MOVEL, "krl": KRL, "rapid": RAPID}
"""Languages by name."""
ENDINGS = {".script": "servoj", ".src": "krl", ".mod": "rapid"}
"""Language of a file, by its ending."""


def save(
    trajectory: Trajectory,
    file: str | Path,
    period: float | None = None,
    *,
    language: str | Language | None = None,
    name: str | None = None,
    blend: float = 0.001,
    axes: Mapping[str, str] | None = None,
) -> None:
    """Write a trajectory to a file, see `Trajectory.save`."""
    form = output_form(trajectory.mechanism, file, period, language, name, axes)
    if form.language is None:
        write_table(form.place, table(trajectory, period), Path(file).suffix)
        return
    points = _samples(trajectory, period)
    if period is not None and form.language.needs_period:
        # Of a stream each point takes a whole period, also the last one.
        points = points._replace(times=period * np.arange(float(len(points.times))))
    elif period is not None:
        points = _without_short_end(points)
    text = program(
        trajectory.mechanism,
        Motion(points.times, points.q, _tip(trajectory, points.q)),
        form.language,
        form.name,
        acceleration=trajectory.limits.acceleration,
        blend=as_number("blend", blend, 0.0, np.inf, InvalidProblem),
        axes=axes,
    )
    with whole_file(form.place) as opened:
        opened.write(text.encode())


def _without_short_end(points: Samples) -> Samples:
    """Leave out the last point but one if it is nearer to the last than half a period: controllers cannot move at once."""
    intervals = np.diff(points.times)
    if len(intervals) > 1 and intervals[-1] < 0.5 * intervals[0]:
        return Samples(*(np.delete(each, -2, axis=0) for each in points))
    return points


def _tip(trajectory: Trajectory, q: Array) -> Array:
    """Return the positions of the tip or of the tool, (k, n) -> (k, 3) [m]."""
    poses = trajectory.mechanism.forward(q)
    return np.asarray((poses if trajectory.tool is None else poses @ trajectory.tool)[:, :3, 3])


class Form(NamedTuple):
    """What `save` writes, and where."""

    place: Path
    """The file, with links resolved."""
    language: Language | None
    """Language of a program; None for a table."""
    name: str
    """Name of a program."""


def output_form(
    mechanism: Mechanism,
    file: str | Path,
    period: float | None = None,
    language: str | Language | None = None,
    name: str | None = None,
    axes: Mapping[str, str] | None = None,
) -> Form:
    """Check what can be checked before a trajectory is computed; see `save`.

    Raises:
        KinseekError: As `save`.
    """
    path = Path(file)
    template = _language(path, language)
    form = Form(output_path(path, "file"), template, path.stem if name is None else name)
    if template is not None:
        require_name(form.name, template)
        assigned(mechanism, template, axes)
        if period is None and template.needs_period:
            raise InvalidProblem(
                f"{str(file)!r} needs a period, the time between two points [s], such as 0.008 or 0.002"
            )
    elif name is not None or axes is not None:
        raise InvalidUse(f"name and axes are for programs, and {str(file)!r} is a table")
    elif path.suffix.lower() == ".parquet":
        import_pyarrow()
    return form


def _language(path: Path, language: str | Language | None) -> Language | None:
    """Return the language of a file; None for a table.

    Raises:
        InvalidProblem: There is none.
    """
    if isinstance(language, Language):
        return language
    if language is not None:
        if not isinstance(language, str) or language not in LANGUAGES:
            raise InvalidProblem(f"{suggest(str(language), LANGUAGES, 'language')}, or a Language")
        return LANGUAGES[language]
    ending = path.suffix.lower()
    if ending in TABLE_ENDINGS:
        return None
    if ending not in ENDINGS:
        raise InvalidProblem(
            f"a trajectory is saved in a file that ends in {', '.join([*TABLE_ENDINGS, *ENDINGS])}, got {str(path)!r}; "
            "another ending needs language="
        )
    return LANGUAGES[ENDINGS[ending]]


def _samples(trajectory: Trajectory, period: float | None) -> Samples:
    """Return points in a period, or at the poses of the path, always with both ends."""
    if period is not None:
        return trajectory.sample(period)
    inner = trajectory.pose_times
    inner = inner[(inner > SAME_TIME) & (inner < trajectory.duration - SAME_TIME)]
    inner = inner[np.diff(inner, prepend=0.0) > SAME_TIME]
    end = [trajectory.duration] if trajectory.duration > 0.0 else []
    times = np.concatenate([[0.0], inner, end])
    return Samples(times, trajectory.q(times), trajectory.velocity(times), trajectory.acceleration(times))


def to_frame(trajectory: Trajectory, period: float | None = None) -> Any:
    """Return a ``pandas.DataFrame``, see `Trajectory.to_frame`."""
    return table(trajectory, period).to_frame()


def to_ros(trajectory: Trajectory, period: float | None = None, messages: Any = None) -> Any:
    """Return a ``trajectory_msgs/JointTrajectory``, see `Trajectory.to_ros`."""
    points = _samples(trajectory, period)
    names = list(trajectory.mechanism.joint_names)
    nanoseconds = [round(t * 1e9) for t in points.times.tolist()]
    columns = {
        "positions": points.q.tolist(),
        "velocities": points.velocity.tolist(),
        "accelerations": points.acceleration.tolist(),
    }
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    stamps = [dict(zip(("sec", "nanosec"), divmod(each, 10**9), strict=True)) for each in nanoseconds]
    if messages is None:
        listed = [{**row, "time_from_start": stamp} for row, stamp in zip(rows, stamps, strict=True)]
        return {"joint_names": names, "points": listed}
    filled = []
    for row, stamp in zip(rows, stamps, strict=True):
        point = messages.JointTrajectoryPoint(**row)
        point.time_from_start.sec, point.time_from_start.nanosec = stamp["sec"], stamp["nanosec"]
        filled.append(point)
    return messages.JointTrajectory(joint_names=names, points=filled)


def table(trajectory: Trajectory, period: float | None) -> Table:
    """Return a row for each point of a trajectory: joint values, the time ``t``, velocities and accelerations."""
    points = _samples(trajectory, period)
    columns = {"t": points.times, "velocity": points.velocity, "acceleration": points.acceleration}
    return Table(trajectory.mechanism.joint_names, points.q, columns, {"point": np.arange(len(points.times))})
