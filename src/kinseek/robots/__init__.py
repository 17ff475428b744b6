"""Where arms come from: every reader returns a `SerialChain`."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot, suggest

from .blackbox import BlackBox, black_box
from .bundled import read_bundled
from .catalog import CatalogEntry, catalog_entry, catalog_names, catalog_path
from .chain import SerialChain
from .dh import read_dh
from .mechanism import Mechanism
from .mjcf import read_mjcf
from .urdf import read_urdf

MAKERS = "kinseek.load(name or file), Arm.from_dh(rows, lower, upper), Arm.from_fk(function, lower, upper)"
"""How an arm is made."""

__all__ = [
    "BlackBox",
    "CatalogEntry",
    "Mechanism",
    "SerialChain",
    "as_mechanism",
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
    _require_readable(source, base, tip)
    if isinstance(source, str) and source in catalog_names():
        if base is None and tip is None and (bundled := read_bundled(source)) is not None:
            return bundled
        entry = catalog_entry(source)
        return read_urdf(catalog_path(source), base or entry.base, tip or entry.tip)

    try:
        path = Path(source).expanduser()
    except RuntimeError as error:  # Nobody is called like that.
        raise InvalidRobot(f"no file {str(source)!r}: {error}") from None
    match path.suffix.lower():
        case ".urdf" | ".xacro":
            return read_urdf(path, base, tip)
        case ".xml":
            return read_urdf(path, base, tip) if _is_urdf(path) else read_mjcf(path, base, tip)
    raise InvalidRobot(
        f"{suggest(str(source), catalog_names(), 'robot')}. A path must end in .urdf, .xacro or .xml"
    )


def as_mechanism(value: Any) -> Mechanism:
    """Make sure that something is a chain, or a function that stands for one, as `kinseek.Arm` takes it.

    Raises:
        InvalidRobot: A name, a file, an arm or anything else.
    """
    if isinstance(value, SerialChain | BlackBox):
        return value
    if isinstance(value, str | os.PathLike):
        raise InvalidRobot(
            f"Arm takes a chain that a reader made, got {value!r}; write kinseek.load({value!r})"
        )
    if isinstance(getattr(value, "mechanism", None), SerialChain | BlackBox):
        raise InvalidRobot("Arm takes a chain that a reader made, got an Arm: it needs no wrapping")
    raise InvalidRobot(
        f"Arm takes a chain that a reader made, got {type(value).__name__}. Ways to make an arm: {MAKERS}"
    )


def _require_readable(source: object, base: object, tip: object) -> None:
    """Refuse what is neither a name nor a path, the models of other libraries above all."""
    if not isinstance(source, str | os.PathLike):
        kind = type(source)
        package = kind.__module__.partition(".")[0]
        known = package not in ("builtins", "__main__", "kinseek")
        what = f"{kind.__module__}.{kind.__qualname__}" if known else kind.__name__
        hint = "; give the file that it was read from" if known else ""
        hint = "; it is an arm already" if package == "kinseek" else hint
        raise InvalidRobot(
            f"source must be the name of a bundled arm or a path to a .urdf, .xacro or .xml file, got {what}{hint}. "
            f"Bundled: {', '.join(catalog_names())}"
        )
    if isinstance(os.fspath(source), bytes):
        raise InvalidRobot(f"source must be a path of letters, got bytes: {os.fspath(source)!r}")
    for name, value in (("base", base), ("tip", tip)):
        if value is not None and not isinstance(value, str):
            raise InvalidRobot(
                f"{name} must be the name of a link, got {value!r:.80} ({type(value).__name__})"
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
