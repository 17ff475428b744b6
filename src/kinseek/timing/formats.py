"""Trajectories in the forms that other programs and robots take: tables, ROS messages, programs of controllers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple, Protocol

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

Array = NDArray[np.float64]

LANGUAGES = {"servoj": SERVOJ, "movej": MOVEJ, "movel": MOVEL, "krl": KRL, "rapid": RAPID}
"""Languages by name."""
ENDINGS = {".script": "servoj", ".src": "krl", ".mod": "rapid"}
"""Language of a file, by its ending."""

_SAME_TIME = 1e-9
"""Points closer together than this are one point [s]: it is the resolution of ROS."""


class Samples(NamedTuple):
    """Points of a trajectory."""

    times: Array
    q: Array
    velocity: Array
    acceleration: Array


class Limits(Protocol):
    """Limits of a trajectory."""

    @property
    def acceleration(self) -> Array:
        """Largest accelerations, (n,), [rad/s²] or [m/s²]."""


class Trajectory(Protocol):
    """What the forms need of a trajectory."""

    @property
    def mechanism(self) -> Mechanism:
        """The arm."""

    @property
    def duration(self) -> float:
        """Duration [s]."""

    @property
    def limits(self) -> Limits:
        """Limits."""

    @property
    def tool(self) -> Array | None:
        """Pose of the tool."""

    @property
    def pose_times(self) -> Array:
        """Times of the poses, (N,) [s]."""

    def q(self, t: Array) -> Array:
        """Return joint values, (k,) -> (k, n)."""

    def velocity(self, t: Array) -> Array:
        """Return velocities, (k,) -> (k, n)."""

    def acceleration(self, t: Array) -> Array:
        """Return accelerations, (k,) -> (k, n)."""

    def sample(self, period: float) -> Samples:
        """Return points in a period."""


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
    """Write a trajectory to a file, completely or not at all.

    Args:
        trajectory: The trajectory.
        file: Its ending selects the form: a table in a .csv, .npy or .parquet file, or a program in a .script (URScript),
            .src (KRL) or .mod (RAPID) file. With a `language`, the ending may be any other.
        period: Time between points [s]; None takes a point at each pose of the path.
        language: Language of a program: ``"servoj"``, ``"movej"``, ``"movel"``, ``"krl"``, ``"rapid"``, or a `Language`.
        name: Name of a program; by default that of the file.
        blend: Largest radius in which the motion of a program may leave a point aside [m], where its language blends.
        axes: Name of the axis of each joint in a program, by joint; by default they are assigned in order.

    Raises:
        InvalidProblem: An unknown ending, a missing folder, a file that cannot be written, a name that is no identifier, or
            an arm that does not have the axes of the language.
        InvalidUse: An argument of programs for a table, or a template with an unknown field.
        MissingExtra: A .parquet file, and pyarrow is not installed.
    """
    form = output_form(trajectory.mechanism, file, period, language, name, axes)
    if form.language is None:
        write_table(form.place, table(trajectory, period))
        return
    points = _samples(trajectory, period)
    if period is not None:
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
        if language not in LANGUAGES:
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
    inner = inner[(inner > _SAME_TIME) & (inner < trajectory.duration - _SAME_TIME)]
    inner = inner[np.diff(inner, prepend=0.0) > _SAME_TIME]
    end = [trajectory.duration] if trajectory.duration > 0.0 else []
    times = np.concatenate([[0.0], inner, end])
    return Samples(times, trajectory.q(times), trajectory.velocity(times), trajectory.acceleration(times))


def to_frame(trajectory: Trajectory, period: float | None = None) -> Any:
    """Return a ``pandas.DataFrame`` with a row for each point: joint values, the time ``t``, velocities and accelerations.

    Args:
        trajectory: The trajectory.
        period: Time between points [s]; None takes a point at each pose of the path.

    Raises:
        MissingExtra: pandas is not installed.
    """
    return table(trajectory, period).to_frame()


def to_ros(trajectory: Trajectory, period: float | None = None, messages: Any = None) -> Any:
    """Return a ``trajectory_msgs/JointTrajectory`` of ROS 2, as a dict or as a message.

    Args:
        trajectory: The trajectory.
        period: Time between points [s]; None takes a point at each pose of the path.
        messages: The module ``trajectory_msgs.msg``, to get a message. kinseek imports nothing of ROS.

    Returns:
        The message, or a dict of its shape: ``joint_names`` and ``points``, each with ``positions``, ``velocities``,
        ``accelerations`` and ``time_from_start``, which has ``sec`` and ``nanosec``.
    """
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
    """Return a row for each point of a trajectory, see `to_frame`."""
    points = _samples(trajectory, period)
    columns = {"t": points.times, "velocity": points.velocity, "acceleration": points.acceleration}
    return Table(trajectory.mechanism.joint_names, points.q, columns, {"point": np.arange(len(points.times))})
