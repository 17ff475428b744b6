"""Where arms come from: every reader returns a `SerialChain`."""

from __future__ import annotations

from pathlib import Path

from kinseek.errors import InvalidRobot, suggest

from .blackbox import BlackBox, black_box
from .catalog import CatalogEntry, catalog_entry, catalog_names, catalog_path
from .chain import SerialChain
from .dh import read_dh
from .mjcf import read_mjcf
from .urdf import read_urdf

__all__ = [
    "BlackBox",
    "CatalogEntry",
    "SerialChain",
    "black_box",
    "catalog_entry",
    "catalog_names",
    "catalog_path",
    "read",
    "read_dh",
    "read_mjcf",
    "read_urdf",
]


def read(source: str | Path, base: str | None = None, tip: str | None = None) -> SerialChain:
    """Read an arm: a bundled one by its name, or a URDF, xacro or MJCF file by its path.

    Args:
        source: Name of a bundled arm, or a path that ends in ``.urdf``, ``.xacro`` or ``.xml``.
        base: Name of the link that stays; the arm's own, or the root of the file, unless given.
        tip: Name of the link that the pose is of; the arm's own, or the only leaf, unless given.

    Raises:
        InvalidRobot: Neither a bundled arm nor a file of these kinds, or the file cannot be used.
        MissingExtra: An MJCF file, and MuJoCo is not installed.
    """
    if isinstance(source, str) and source in catalog_names():
        entry = catalog_entry(source)
        return read_urdf(catalog_path(source), base or entry.base, tip or entry.tip)

    path = Path(source).expanduser()
    match path.suffix.lower():
        case ".urdf" | ".xacro":
            return read_urdf(path, base, tip)
        case ".xml":
            return read_urdf(path, base, tip) if _is_urdf(path) else read_mjcf(path, base, tip)
    raise InvalidRobot(
        f"{suggest(str(source), catalog_names(), 'robot')}. A path must end in .urdf, .xacro or .xml"
    )


def _is_urdf(path: Path) -> bool:
    """Return whether an .xml file holds a URDF robot; broken XML is an MJCF matter, for MuJoCo to explain."""
    from .files import file_bytes
    from .urdf_xml import root_element

    try:
        root = root_element(file_bytes(path), str(path))
    except InvalidRobot:
        return False
    return bool(root.tag.endswith("robot"))
