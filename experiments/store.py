"""Results on disk: a CSV that grows row by row, a manifest beside it, and the picture drawn from the two."""

from __future__ import annotations

import csv
import json
import os
import platform
import subprocess
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

from benchmarks.targets import processor

from .effort import Effort, Row

PACKAGES = ("kinseek", "numpy", "numba", "scipy", "matplotlib")


class ExperimentError(Exception):
    """Something that the caller can put right; the message says how."""


@dataclass(frozen=True)
class Store:
    """The files of one experiment in one folder."""

    folder: Path
    name: str

    @property
    def csv(self) -> Path:
        """Finished rows."""
        return self.folder / f"{self.name}.csv"

    @property
    def picture(self) -> Path:
        """The drawing."""
        return self.folder / f"{self.name}.png"

    @property
    def manifest(self) -> Path:
        """How the rows came to be."""
        return self.folder / f"{self.name}.json"

    @property
    def partial(self) -> Path:
        """Rows of a run that is not finished."""
        return self.folder / f"{self.name}.csv.part"

    @property
    def partial_manifest(self) -> Path:
        """The arguments of a run that is not finished."""
        return self.folder / f"{self.name}.json.part"

    def finished(self, effort: Effort) -> bool:
        """Are the rows of these very arguments there, whole?"""
        return self.csv.exists() and _arguments(self.manifest) == asdict(effort)

    def begin(self, effort: Effort) -> list[Row]:
        """Open a run; return the whole rows that an interrupted one with the same arguments left behind."""
        self.folder.mkdir(parents=True, exist_ok=True)
        rows: list[Row] = []
        if self.partial.exists() and _arguments(self.partial_manifest) == asdict(effort):
            rows = read_rows(self.partial, torn=True)
        self._rewrite(rows)
        self.partial_manifest.write_text(json.dumps({"arguments": asdict(effort)}))
        return rows

    def append(self, row: Row) -> None:
        """Write one row so that it survives whatever comes next; the first one brings the names of the columns."""
        with self.partial.open("a+", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            if not file.tell():
                writer.writerow(row)
            writer.writerow(map(_short, row.values()))
            file.flush()
            os.fsync(file.fileno())

    def finish(self, effort: Effort, cases: Sequence[Row], seconds: float) -> None:
        """Put the rows in the order of the cases and give them their final name, all at once."""
        keys = tuple(cases[0])
        place = {key_of(case, keys): number for number, case in enumerate(cases)}
        rows = read_rows(self.partial)
        self._rewrite(sorted(rows, key=lambda row: place[key_of(row, keys)]))
        described = describe(self.name, effort, len(rows), seconds)
        self.partial_manifest.write_text(json.dumps(described, indent=2) + "\n")
        # Without a manifest nothing counts as finished, so a stop between these steps costs a run, no truth.
        self.manifest.unlink(missing_ok=True)
        self.partial.replace(self.csv)
        self.partial_manifest.replace(self.manifest)

    def rows(self, keys: Iterable[str] = ()) -> list[Row]:
        """The finished rows.

        Raises:
            ExperimentError: The first columns are not the wanted ones, or a row is not whole.
        """
        rows, wanted = read_rows(self.csv), tuple(keys)
        if not rows or tuple(rows[0])[: len(wanted)] != wanted:
            raise ExperimentError(
                f"{self.csv.name} has other columns than this version writes; run again with --force"
            )
        return rows

    def _rewrite(self, rows: Sequence[Row]) -> None:
        fresh = self.partial.with_suffix(".new")
        with fresh.open("w", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerows(rows[:1])
            writer.writerows(map(_short, row.values()) for row in rows)
        fresh.replace(self.partial)


def key_of(row: Row, keys: Sequence[str]) -> tuple[str, ...]:
    """The values that identify a row, as they are written in the CSV."""
    return tuple(str(_short(row[key])) for key in keys)


def read_rows(path: Path, torn: bool = False) -> list[Row]:
    """Read a CSV; numbers come back as numbers.

    Args:
        path: The CSV.
        torn: Leave out a last line that was cut short, instead of refusing it.

    Raises:
        ExperimentError: A row does not fit the header.
    """
    text = path.read_text()
    if torn:
        text = text[: text.rfind("\n") + 1]
    columns, *lines = list(csv.reader(text.splitlines())) or [[]]
    for number, line in enumerate(lines, start=2):
        if len(line) != len(columns):
            raise ExperimentError(f"{path.name}, line {number}: {len(line)} fields, expected {len(columns)}")
    return [dict(zip(columns, map(_value, line), strict=True)) for line in lines]


def describe(name: str, effort: Effort, rows: int, seconds: float) -> dict[str, Any]:
    """What a reader needs in order to judge the numbers, or to get them again."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            versions[package] = "not installed"
    return {
        "experiment": name,
        "command": f"python -m experiments {name}" + (" --quick" if effort.quick else ""),
        "arguments": asdict(effort),
        "rows": rows,
        "seconds": round(seconds, 1),
        "finished": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "versions": versions,
        "processor": processor(),
        "cores": os.cpu_count(),
        "system": f"{platform.system()} {platform.machine()}",
        "commit": commit(),
    }


def commit() -> str:
    """The commit that ran, with a mark if what runs differs from it; results are what it writes."""
    here = Path(__file__).parent

    def git(*words: str) -> str:
        done = subprocess.run(["git", *words], cwd=here, capture_output=True, text=True, check=True)
        return done.stdout.strip()

    try:
        changed = git("status", "--porcelain", "--", "../src", ".", ":(exclude)results")
        return git("rev-parse", "HEAD") + (" with changes" if changed else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _arguments(manifest: Path) -> Any:
    try:
        return json.loads(manifest.read_text())["arguments"]
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _short(value: Any) -> Any:
    """Six significant digits: more would only show the noise of a clock."""
    return float(f"{value:.6g}") if isinstance(value, float) else value


def _value(field: str) -> Any:
    for kind in (int, float):
        try:
            return kind(field)
        except ValueError:
            continue
    return field
