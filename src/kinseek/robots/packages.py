"""Where the files are that a robot's file names: beside it, or in a ROS package."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from itertools import accumulate
from pathlib import Path, PureWindowsPath
from urllib.parse import unquote

from kinseek.errors import InvalidRobot


def mesh_path(name: str, robot: Path, packages: Mapping[str, str | Path], option: str = "packages=") -> Path:
    """Where a mesh is that a robot's file names.

    Args:
        name: A path, beside the robot's file if it is relative, or a ``file://``, ``package://`` or ``model://`` address.
        robot: The robot's file.
        packages: Folders of packages by name; others are looked for on the way up from the file, and where ROS keeps them.
        option: Where the user can give more of them, for messages.

    Raises:
        InvalidRobot: Another kind of address, one that leads out of its package, or a package that is nowhere.
    """
    if (found := in_package(name)) is None:
        rest = name.rpartition("://")[2]
        path = robot.parent / (unquote(rest) if rest != name else rest)
        return path if os.path.isfile(path) else robot.parent / unquote(rest)
    package, inside = found
    for folder in _folders(package, robot, packages):
        if os.path.isfile(folder / inside):
            return folder / inside
    raise InvalidRobot(
        f"{name!r} was not found: say where the package {package!r} is with {option}, or set ROS_PACKAGE_PATH"
    )


def in_package(name: str) -> tuple[str, str] | None:
    """The package of a ``package://`` or ``model://`` address and the path in it; None of a path or a ``file://`` address.

    Raises:
        InvalidRobot: Another kind of address, or one that leads out of its package.
    """
    scheme, _, rest = name.rpartition("://")
    if scheme in ("", "file"):
        return None
    if scheme not in ("package", "model"):
        raise InvalidRobot(f"{name!r} is neither a path nor a package:// address")
    package, _, inside = unquote(rest).partition("/")
    if not PureWindowsPath(package).parts or not (_stays_inside(package) and _stays_inside(inside)):
        raise InvalidRobot(
            f"{name!r} leads out of its package: got the path {inside!r} in the package {package!r}, expected the name of a "
            "folder and a relative path that stays in it"
        )
    return package, inside


def _stays_inside(path: str) -> bool:
    """Does a path never leave the folder that it starts from? Read as on Windows, so for both kinds of slashes."""
    way = PureWindowsPath(path)
    depths = accumulate(-1 if part == ".." else 1 for part in way.parts)
    return not way.anchor and min(depths, default=0) >= 0


def _folders(package: str, robot: Path, packages: Mapping[str, str | Path]) -> Iterator[Path]:
    """Folders that may be a package's."""
    if package in packages:
        yield Path(packages[package]).expanduser()
    for parent in robot.resolve().parents:
        if parent.name == package:
            yield parent
        yield parent / package
    for variable, inner in (
        ("ROS_PACKAGE_PATH", ""),
        ("AMENT_PREFIX_PATH", "share"),
        ("COLCON_PREFIX_PATH", "share"),
    ):
        for prefix in filter(None, os.environ.get(variable, "").split(os.pathsep)):
            folder = Path(prefix)
            yield folder / inner / package
            yield folder if folder.name == package else folder / package / "share" / package
