"""Find the files that a robot's file refers to: beside it, or in a ROS package."""

from __future__ import annotations

import os
import stat
from collections.abc import Iterator, Mapping
from itertools import accumulate
from pathlib import Path, PureWindowsPath

from kinseek.errors import InvalidRobot
from kinseek.support.forks import importing

from .files import home_path, require_here, without_links


def mesh_path(name: str, robot: Path, packages: Mapping[str, str | Path], option: str = "packages=") -> Path:
    """Return the path of a mesh that a robot's file refers to.

    Args:
        name: A path, relative to the robot's file or absolute, or a ``file://``, ``package://`` or ``model://`` address.
        robot: The robot's file.
        packages: Folders of packages by name; others are searched in the parent folders of the file, and where ROS keeps
            them.
        option: Option by which the user can add packages, for messages.

    Raises:
        InvalidRobot: The kind of address is not supported, it leads out of its package or to another machine, or the package
            is not found.
    """
    if (found := in_package(name)) is None:
        rest = name.rpartition("://")[2]
        require_here(_unquoted(rest), robot, packages.values())
        path = robot.parent / (_unquoted(rest) if rest != name else rest)
        return path if os.path.isfile(path) else robot.parent / _unquoted(rest)
    package, inside = found
    for folder in _folders(package, robot, packages):
        if os.path.isfile(folder / inside):
            return folder / inside
    raise InvalidRobot(
        f"{name!r} was not found: give the folder of the package {package!r} with {option}, or set ROS_PACKAGE_PATH"
    )


def in_package(name: str) -> tuple[str, str] | None:
    """Return package and path of a ``package://`` or ``model://`` address; None for a path or a ``file://`` address.

    Raises:
        InvalidRobot: The kind of address is not supported, or it leads out of its package.
    """
    scheme, _, rest = name.rpartition("://")
    if scheme in ("", "file"):
        return None
    if scheme not in ("package", "model"):
        raise InvalidRobot(f"{name!r} is neither a path nor a package:// address")
    package, _, inside = _unquoted(rest).partition("/")
    if not PureWindowsPath(package).parts or not (_stays_inside(package) and _stays_inside(inside)):
        raise InvalidRobot(
            f"{name!r} leads out of its package: got the path {inside!r} in the package {package!r}, expected the name of a "
            "folder and a relative path that stays in it"
        )
    return package, inside


def _unquoted(address: str) -> str:
    """Replace %xx escapes."""
    with importing:
        from urllib.parse import unquote

    return unquote(address)


def is_planted(entry: Path, robot: Path) -> bool:
    """Return whether another user may have put an entry into a folder above a robot's file, or may do so at any moment.

    In a folder like ``/tmp`` everyone can make a package of any name. What the user, root or the owner of the file has made
    there is accepted. What is not there is not: another user could make it between this check and its use. A sticky
    folder of a group is treated alike. In its other folders, members of a group can replace the files of each other anyway.

    Args:
        entry: A file or folder.
        robot: The robot's file.
    """
    if not hasattr(os, "geteuid"):
        return False
    try:
        mode = entry.parent.stat().st_mode
        if not mode & stat.S_IWOTH and not (mode & stat.S_IWGRP and mode & stat.S_ISVTX):
            return False
        known = {0, os.geteuid(), *([robot.stat().st_uid] if robot.exists() else [])}  # It may be a text.
        return entry.lstat().st_uid not in known
    except (OSError, ValueError):  # It is not there, or its name cannot be a file's.
        return True


def _stays_inside(path: str) -> bool:
    """Return whether a path never leaves its start folder. It is parsed as on Windows, so with both kinds of slashes."""
    way = PureWindowsPath(path)
    depths = accumulate(-1 if part == ".." else 1 for part in way.parts)
    return not way.anchor and min(depths, default=0) >= 0


def _folders(package: str, robot: Path, packages: Mapping[str, str | Path]) -> Iterator[Path]:
    """Iterate over the folders that may belong to a package."""
    if package in packages:
        yield home_path(packages[package])
    for parent in without_links(robot).parents:
        if parent.name == package:
            yield parent
        if not is_planted(parent / package, robot):
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
