"""A record of a search, pass by pass, kept with ``trace=True``.

>>> solution = arm.ik(target, solver=kinseek.DivideAndConquer(breadth=3), trace=True)   # doctest: +SKIP
>>> print(solution.trace)                                                               # doctest: +SKIP

A trace holds only numbers and sentences, and no reference to the arm or the search, so it can be pickled and stored.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import InvalidUse
from .printable import printable
from .support.whole_file import output_path, whole_file

Array = NDArray[np.float64]

WIDTH, NAME = 80, 12
"""Maximum length of a line of the printed table, and of a pass's name in it if space is short."""

SHOWN = 40
"""Maximum number of passes that are printed: the first and the last half of them."""

MOST_MEMORY = 2**28
"""Maximum memory of the traces of a batch [bytes]."""


@dataclass(frozen=True, eq=False)
class Pass:
    """One pass of a search: the region searched, the best joint values after it, and the work it took.

    Errors are those of `q` by plain forward kinematics; `evaluations` does not include computing them.

    Attributes:
        name: Name of the pass, such as ``"pass 2"``, ``"sweep 1"`` or ``"look-up"``.
        q: The best joint values known after the pass, (n,), [rad] or [m].
        weighted_error: Of q, no unit.
        position_error: Of q [m].
        orientation_error: Of q [rad].
        evaluations: FK evaluations of this pass alone.
        nodes_created: Nodes made in this pass.
        nodes_expanded: Nodes visited in this pass.
        memory: Memory of the search's own tables during the pass [bytes].
        spacing: Distance between neighbouring values of each joint, (n,), [rad] or [m]; NaN for a joint that the pass does
            not vary. None if the pass has no grid.
        lower: Lowest value of each joint in the pass's window, (n,), [rad] or [m]. If a joint has a full turn, the window
            may extend beyond the joint's range and then continues at its other end. None without a window.
        upper: Highest value of each joint in the window, in the same form.
        counts: Number of values of each joint in the window, (n,); 1 for a joint that the pass does not vary.
        cells: Number of windows of this pass, more than one in a beam search; `lower` and `upper` are those around the best.
        start: Joint values where the pass began, (n,), if they differ from the best before it, as a seed does; else None.
        start_error: Weighted error at `start`; NaN if there is none.
    """

    name: str
    q: Array
    weighted_error: float
    position_error: float
    orientation_error: float
    evaluations: int
    nodes_created: int = 0
    nodes_expanded: int = 0
    memory: int = 0
    spacing: Array | None = None
    lower: Array | None = None
    upper: Array | None = None
    counts: NDArray[np.int64] | None = None
    cells: int = 1
    start: Array | None = None
    start_error: float = float("nan")

    def values(self, joint: int) -> Array:
        """Values of one joint in the window, evenly spread, (counts[joint],), [rad] or [m].

        Raises:
            InvalidUse: The pass has no window.
        """
        lower, upper = self.ends
        count = 0 if self.counts is None else int(self.counts[joint])
        return np.linspace(lower[joint], upper[joint], count)

    @property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest value of each joint in the window, (n,) each.

        Raises:
            InvalidUse: The pass has no window.
        """
        if self.lower is None or self.upper is None:
            raise InvalidUse(f"{self.name!r} has no window: it is not a pass over a grid")
        return self.lower, self.upper

    def to_dict(self) -> dict[str, Any]:
        """All fields as JSON takes them: lists for arrays, None for NaN and infinity."""
        return {each.name: _plain(getattr(self, each.name)) for each in fields(self)}

    def __repr__(self) -> str:
        """A short form for lists of passes."""
        return (
            f"Pass({self.name!r}, {self.evaluations:,} evaluations, weighted error {self.weighted_error:.3g})"
        )


@dataclass(frozen=True, eq=False)
class Trace:
    """What a search did, pass by pass; ``print(trace)`` shows it as a table.

    A trace is a sequence of its passes: it has a length, and can be iterated and indexed.

    Attributes:
        search: Name of the search.
        joint_names: Names of the joints, base to tip.
        kinds: Kind of each joint: ``"revolute"``, ``"continuous"``, ``"prismatic"`` or ``"number"``.
        passes: The passes, in order.
        notes: Remarks on this search, one sentence each.
    """

    search: str
    joint_names: tuple[str, ...]
    kinds: tuple[str, ...]
    passes: tuple[Pass, ...]
    notes: tuple[str, ...] = ()

    @property
    def evaluations(self) -> NDArray[np.int64]:
        """FK evaluations spent up to the end of each pass, (passes,)."""
        return np.cumsum([each.evaluations for each in self.passes], dtype=np.int64)

    @property
    def weighted_errors(self) -> Array:
        """Weighted error of the best known after each pass, (passes,)."""
        return np.array([each.weighted_error for each in self.passes], dtype=float)

    @property
    def position_errors(self) -> Array:
        """Position error of the best known after each pass, (passes,), [m]."""
        return np.array([each.position_error for each in self.passes], dtype=float)

    @property
    def orientation_errors(self) -> Array:
        """Orientation error of the best known after each pass, (passes,), [rad]."""
        return np.array([each.orientation_error for each in self.passes], dtype=float)

    @property
    def nodes_created(self) -> int:
        """Nodes made in all passes."""
        return sum(each.nodes_created for each in self.passes)

    @property
    def nodes_expanded(self) -> int:
        """Nodes visited in all passes."""
        return sum(each.nodes_expanded for each in self.passes)

    @property
    def memory(self) -> int:
        """Largest memory during any pass [bytes]."""
        return max((each.memory for each in self.passes), default=0)

    def rows(self) -> list[dict[str, Any]]:
        """Return one flat mapping per pass, with a column for each number of each joint, for a table or a CSV file."""
        rows: list[dict[str, Any]] = []
        for number, (each, spent) in enumerate(zip(self.passes, self.evaluations.tolist(), strict=True), 1):
            row: dict[str, Any] = {"number": number, "evaluations_so_far": spent}
            for key, value in each.to_dict().items():
                if key in ("q", "spacing", "lower", "upper", "counts", "start"):
                    entries = [None] * len(self.joint_names) if value is None else value
                    row |= {
                        f"{key}_{name}": entry for name, entry in zip(self.joint_names, entries, strict=True)
                    }
                else:
                    row[key] = value
            rows.append(row)
        return rows

    def to_dict(self) -> dict[str, Any]:
        """All fields as JSON takes them: lists for arrays, None for NaN and infinity."""
        return {
            "search": self.search,
            "joint_names": list(self.joint_names),
            "kinds": list(self.kinds),
            "passes": [each.to_dict() for each in self.passes],
            "notes": list(self.notes),
        }

    def save(self, path: str | Path) -> Path:
        """Write `to_dict` as a JSON file.

        Raises:
            InvalidProblem: The file cannot be written.
        """
        with whole_file(output_path(Path(path), "the file of the trace")) as file:
            file.write(f"{json.dumps(self.to_dict(), indent=1, allow_nan=False)}\n".encode())
        return Path(path)

    def __len__(self) -> int:
        """Number of passes."""
        return len(self.passes)

    def __iter__(self) -> Iterator[Pass]:
        """Iterate over the passes."""
        return iter(self.passes)

    def __getitem__(self, number: int) -> Pass:
        """Return one pass."""
        return self.passes[number]

    def __repr__(self) -> str:
        """A short form; `print` shows the table."""
        if not self.passes:
            return f"Trace({self.search!r}, no passes)"
        spent, last = int(self.evaluations[-1]), self.passes[-1]
        passes = f"{len(self)} pass{'es' if len(self) > 1 else ''}"
        return f"Trace({self.search!r}, {passes}, {spent:,} evaluations, weighted error {last.weighted_error:.3g})"

    def __str__(self) -> str:
        """A table of the passes, within 80 columns; the spacing is the largest of all joints."""
        slides = "prismatic" in self.kinds or "number" in self.kinds
        turns = any(kind in ("revolute", "continuous") for kind in self.kinds)
        unit = "rad or m" if slides and turns else "m" if slides else "rad"
        if "number" in self.kinds:
            unit = "its unit"
        head = (
            ("", "spacing", "values", "FK", "weighted", "position", "angle"),
            ("pass", unit, "a joint", "so far", "error", "m", "rad"),
        )
        body = [
            self._line(each, spent)
            for each, spent in zip(self.passes, self.evaluations.tolist(), strict=True)
        ]
        if len(body) > SHOWN:
            left = len(body) - SHOWN
            more = (f"... {left} more", *[""] * (len(head[0]) - 1))
            body = [*body[: SHOWN // 2], more, *body[-(SHOWN // 2) :]]
        table = [*head, *body]
        widths = [max(len(row[i]) for row in table) for i in range(len(head[0]))]
        room = max(NAME, WIDTH - sum(widths[1:]) - 2 * len(widths[1:]))
        table = [(_shortened(row[0], room), *row[1:]) for row in table]
        widths[0] = max(len(row[0]) for row in table)
        lines = [self.search]
        for row in table:
            cells = [row[0].ljust(widths[0]), *(c.rjust(w) for c, w in zip(row[1:], widths[1:], strict=True))]
            lines.append("  ".join(cells).rstrip())
        lines.append(
            f"{self.nodes_created:,} nodes created, {self.nodes_expanded:,} expanded, {_bytes(self.memory)} held"
        )
        return "\n".join(map(printable, [*lines, *(part for note in self.notes for part in _wrapped(note))]))

    def _line(self, each: Pass, spent: int) -> tuple[str, ...]:
        """Format one pass as the columns of the table."""
        if each.counts is None:
            values = ""
        else:
            least, most = int(each.counts.min()), int(each.counts.max())
            values = f"{most}" if least == most else f"{least} to {most}"
            values = values if each.cells == 1 else f"{each.cells:,} x {values}"
        spacing = ""
        if each.spacing is not None and np.isfinite(each.spacing).any():
            spacing = f"{np.nanmax(each.spacing):.3g}"
        errors = each.weighted_error, each.position_error, each.orientation_error
        work = f"{spent:,}" if spent < 10**9 else f"{spent:.4g}"
        return each.name, spacing, values, work, *(f"{error:.2e}" for error in errors)


def require_memory(targets: int, passes: int, dof: int, notes: int = 0) -> None:
    """Check that traces fit into memory.

    Args:
        targets: Number of targets.
        passes: Maximum number of passes of one target.
        dof: Number of joints.
        notes: Maximum number of notes of one target.

    Raises:
        InvalidUse: The traces would take too much memory; the message says how much.
    """
    each = passes * pass_memory(dof) + 512 * (notes + 1)
    if targets * each <= MOST_MEMORY:
        return
    fit = MOST_MEMORY // each
    fewer = f"trace at most {fit:,} at a time" if fit else "choose a search of fewer passes"
    raise InvalidUse(
        f"the traces of {targets:,} targets would take up to {_bytes(targets * each)} ({passes:,} passes of "
        f"{pass_memory(dof):,} bytes a target), expected at most {_bytes(MOST_MEMORY)}: {fewer}"
    )


def pass_memory(dof: int) -> int:
    """Maximum memory of a pass [bytes]: the object, its numbers, and six arrays of one number per joint."""
    return 1024 + 6 * (112 + 8 * dof)


def _plain(value: Any) -> Any:
    """Convert numbers and lists of them to what JSON accepts."""
    if isinstance(value, np.ndarray):
        return [_plain(each) for each in value.tolist()]
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return value


def _bytes(count: int) -> str:
    """Format a size in bytes."""
    size, units = float(count), ("bytes", "KiB", "MiB", "GiB", "TiB")
    for unit in units[:-1]:
        if size < 1024:
            return f"{size:.0f} {unit}" if unit == "bytes" else f"{size:.1f} {unit}"
        size /= 1024
    return f"{size:,.1f} {units[-1]}"


def _shortened(name: str, room: int) -> str:
    """Shorten the name of a pass to this length, keeping the number at its end."""
    if len(name) <= room:
        return name
    end = name.rpartition(" ")[2][-6:]
    return f"{name[: room - 3 - len(end)].rstrip()}.. {end}"


def _wrapped(note: str) -> list[str]:
    """Wrap a note into lines."""
    import textwrap

    return textwrap.wrap(note, WIDTH, initial_indent="note: ", subsequent_indent="      ")
