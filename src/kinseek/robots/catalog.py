"""The bundled arms: one URDF file each in ``catalog/``, with the arm's metadata in the first comment.

    <!--
    Franka Emika Panda
    Kinematic data only.
    source: moveit/moveit_resources panda_description/urdf/panda.urdf @ ef5836d…
    licence: Apache-2.0
    base: panda_link0
    tip: panda_link8
    -->

To add an arm, add its file.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from kinseek.errors import InvalidRobot, suggest

_COMMENT = re.compile(r"<!--(.*?)-->", re.DOTALL)
_MOVING = re.compile(r'<joint\b[^>]*type="(?:revolute|continuous|prismatic)"')


@dataclass(frozen=True)
class CatalogEntry:
    """Metadata of a bundled arm."""

    name: str
    description: str
    source: str
    """Repository, path and commit of the numbers."""
    licence: str
    limits: str
    """Source of the limits and speeds, and their known errors."""
    base: str
    """Name of the base link."""
    tip: str
    """Name of the link whose pose is computed."""
    dof: int
    """Number of joint variables."""

    @property
    def differs(self) -> bool:
        """Whether limits or speeds are known to differ from those of the real arm."""
        return "differ from" in self.limits


def catalog_names() -> tuple[str, ...]:
    """Return the names of all bundled arms, sorted."""
    return tuple(sorted(path.stem for path in _folder().glob("*.urdf")))


def catalog_path(name: str) -> Path:
    """Return the path of a bundled arm's URDF file.

    Raises:
        InvalidRobot: There is no such arm.
    """
    if name not in (names := catalog_names()):
        raise InvalidRobot(suggest(name, names, "robot"))
    return _folder() / f"{name}.urdf"


def catalog_entry(name: str) -> CatalogEntry:
    """Return the metadata of a bundled arm.

    Raises:
        InvalidRobot: There is no such arm.
    """
    text = catalog_path(name).read_text(encoding="utf-8")
    comment = _COMMENT.search(text)
    lines = comment[1].strip().splitlines() if comment else []
    facts = {key: value for key, _, value in (line.partition(": ") for line in lines)}
    return CatalogEntry(
        name=name,
        description=lines[0],
        source=facts["source"],
        licence=facts["licence"],
        limits=facts["limits"],
        base=facts["base"],
        tip=facts["tip"],
        dof=len(_MOVING.findall(text)) - text.count("<mimic "),
    )


def limits_table() -> str:
    """Return the sources of all bundled arms' limits and speeds, as the Markdown table of docs/arms.md."""
    rows = [(name, catalog_entry(name).limits.replace("|", r"\|")) for name in catalog_names()]
    return "\n".join(["| arm | limits and speeds |", "| --- | --- |", *(f"| `{a}` | {b} |" for a, b in rows)])


def _folder() -> Path:
    return Path(__file__).with_name("catalog")
