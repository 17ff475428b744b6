"""Expand xacro files into URDF: arguments, ROS packages, and errors.

xacro itself expands the files. `xacro_limits` bounds the work, and `xacro_untrusted` evaluates expressions without Python.
"""

from __future__ import annotations

import contextlib
import os
import re
import threading
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot, reason, suggest
from kinseek.support.forks import finish_first, importing
from kinseek.support.interrupts import raise_of_handler

from .files import file_bytes, home_path, without_links
from .packages import is_planted
from .xacro_limits import Changes, limits
from .xacro_untrusted import evaluation

_LOCK = threading.RLock()
"""Lock for expanding one file at a time, since xacro keeps its state in its module."""
finish_first(_LOCK)
_LOST_PACKAGE = re.compile(r"Package not found: (\S+)")
"""Message of xacrodoc, wrapped by xacro."""


class _Arguments(dict[str, str]):
    """Arguments of a xacro file; the class records which of them the file requests."""

    def __init__(self, given: Mapping[str, str]) -> None:
        super().__init__(given)
        self.requested: set[str] = set()

    def __contains__(self, name: object) -> bool:
        self.requested.add(str(name))
        return super().__contains__(name)

    def __getitem__(self, name: str) -> str:
        self.requested.add(name)
        return super().__getitem__(name)


def expand_xacro(
    path: Path,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> bytes:
    """Expand a xacro file into URDF text.

    Args:
        path: The file.
        args: Values of its arguments, by name; booleans are written as xacro reads them.
        packages: Folders of ROS packages, by name. Others are searched in the parent folders of the file, and where ROS
            keeps them.
        trusted: Whether Python may evaluate its expressions. Otherwise `expressions` does, and the environment is not read.

    Raises:
        InvalidRobot: The file is missing, the file has no such argument, a package is not a folder, or xacro cannot process
            the file; the message is then xacro's own.
    """
    file_bytes(path)
    arguments = _Arguments({str(name): _as_xacro(value) for name, value in (args or {}).items()})
    text = _expanded(path, arguments, _folders(packages or {}), trusted)
    for name in args or {}:
        if name not in arguments.requested:
            raise InvalidRobot(f"{path}: {suggest(str(name), arguments.requested, 'argument')}")
    return text


def urdf_text(
    path: Path,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
) -> bytes:
    """Return the text of a file; a xacro file is expanded, with the arguments of `expand_xacro`.

    Raises:
        InvalidRobot: It cannot be read or expanded.
    """
    is_xacro = path.suffix.lower() == ".xacro"
    return expand_xacro(path, args, packages, trusted) if is_xacro else file_bytes(path)


def _as_xacro(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _folders(packages: Mapping[str, str | Path]) -> dict[str, str]:
    for name, folder in packages.items():
        if not os.path.isdir(home_path(folder)):
            raise InvalidRobot(f"package {name!r}: no folder {str(folder)!r}")
    return {name: str(without_links(home_path(folder))) for name, folder in packages.items()}


def _expanded(path: Path, arguments: _Arguments, folders: Mapping[str, str], trusted: bool) -> bytes:
    with importing:
        from xacrodoc import packages
        from xacrodoc.xacrodoc import xacro

    # xacro and xacrodoc keep their state in modules, so only one file is expanded at a time.
    with _LOCK:
        changes, spend = limits(path, folders.values())
        # Packages found for one file must not be used for the next file: use a copy.
        finder = packages.PackageFinder()
        finder.finder_funcs[:] = packages._finder.finder_funcs
        finder.package_cache.update(packages._finder.package_cache | folders)
        finder.finder_funcs.insert(0, (_finder_above(path), packages.PackageNotFoundError))
        changes = (*changes, (packages, {"_finder": finder}), *(() if trusted else evaluation(path, spend)))
        with _replaced(changes):
            return _processed(xacro, path, arguments)


def _processed(xacro: Any, path: Path, arguments: _Arguments) -> bytes:
    """Let xacro expand a file.

    Raises:
        InvalidRobot: xacro or a limit rejects it.
    """
    try:
        # Otherwise relative includes would be searched in the working directory.
        xacro.init_stacks(str(path))
        # Once: xacrodoc repeats it until nothing changes, and so would evaluate $${…}, which stands for ${…}.
        document = xacro.parse(None, str(path))
        xacro.process_doc(document, mappings=arguments)
        if document.doctype is not None:  # Its entities and defaults are in their places now.
            document.removeChild(document.doctype)
        return bytes(document.toxml(encoding="utf-8"))
    except InvalidRobot:
        raise
    except Exception as error:  # xacro evaluates expressions of the file, which may raise anything.
        raise_of_handler(getattr(error, "exc", None) or error)  # xacro's own errors wrap others.
        refused = _refusal(error)
        if refused is not None:
            raise refused from None
        why = reason(error)
        if lost := _LOST_PACKAGE.search(why):
            why = f"package {lost[1]!r} is not found; say where it is with packages={{name: folder}}, in a shell "
            why += "--package NAME=FOLDER"
        raise InvalidRobot(f"{path}: xacro failed: {why}") from None


@contextlib.contextmanager
def _replaced(changes: tuple[Changes, ...]) -> Iterator[None]:
    """Replace names of modules for a while."""
    before = [{name: vars(module)[name] for name in new if name in vars(module)} for module, new in changes]
    try:
        for module, new in changes:
            vars(module).update(new)
        yield
    finally:
        for (module, new), old in reversed(list(zip(changes, before, strict=True))):
            for name in new:
                vars(module).pop(name, None)
            vars(module).update(old)


def _finder_above(path: Path) -> Callable[[str], str]:
    """Return a function that finds a package in the folders above a file.

    It does what `packages.walk_up_from` of xacrodoc does, but leaves out manifests that another user may have planted:
    files of a package may be run.
    """
    from xacrodoc import packages

    def find(package: str) -> str:
        for folder in without_links(path).parents[:-1]:
            manifest, old = folder / "package.xml", folder / "manifest.xml"
            if manifest.exists() and not is_planted(manifest, path):
                with packages.open(manifest) as file:
                    names = packages.minidom.parse(file).getElementsByTagName("name")
                if len(names) != 1:
                    raise InvalidRobot(f"{manifest}: {len(names)} <name> elements, expected one")
                if names[0].firstChild is not None and names[0].firstChild.data == package:
                    return str(folder)
            # Manifests of rosbuild contain no name.
            if old.exists() and not is_planted(old, path):
                return str(folder)
        raise packages.PackageNotFoundError(package)

    return find


def _refusal(error: BaseException) -> InvalidRobot | None:
    """Return kinseek's own rejection, which xacro may have wrapped into an error of its own."""
    inner: BaseException | None = error
    seen: set[int] = set()
    while inner is not None and id(inner) not in seen:
        if isinstance(inner, InvalidRobot):
            return inner
        seen.add(id(inner))
        inner = getattr(inner, "exc", None) or inner.__cause__ or inner.__context__
    return None
