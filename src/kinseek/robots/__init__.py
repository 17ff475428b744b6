"""Read arms from many sources: every reader returns a `SerialChain`."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from kinseek.errors import InvalidRobot, suggest
from kinseek.support.lazy_imports import lazy_names
from kinseek.support.validation import as_flag

from .adapters import (
    described,
    hint_at,
    is_described,
    is_text,
    read_model_of_library,
    urdf_of_model,
    urdf_of_text,
)
from .blackbox import BlackBox, black_box
from .bundled import read_bundled
from .catalog import CatalogEntry, catalog_entry, catalog_names, catalog_path
from .chain import Limits, SerialChain, with_limits
from .dh import read_dh
from .files import ANY_ENDING, home_path, instead_of_a_description
from .mechanism import Mechanism
from .urdf import Urdf, read_urdf, urdf_of_file

MAKERS = "kinseek.load(name or file), Arm.from_dh(rows, lower, upper), Arm.from_fk(function, lower, upper)"
"""The ways to create an arm, for messages."""

if TYPE_CHECKING:
    from .calibration import Calibration
    from .mjcf import read_mjcf

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

__getattr__, __dir__ = lazy_names(globals(), {"read_mjcf": ".mjcf"})


def read(
    source: Any,
    base: str | None = None,
    tip: str | None = None,
    *,
    args: Mapping[str, Any] | None = None,
    packages: Mapping[str, str | Path] | None = None,
    trusted: bool = True,
    calibration: Calibration | None = None,
    srdf: str | Path | bytes | None = None,
    group: str | None = None,
    limits: Limits | str | os.PathLike[str] | None = None,
) -> SerialChain:
    """Read an arm: a bundled one by name, a URDF, xacro or MJCF file by path, or a model of another library.

    Args:
        source: Name of a bundled arm or of one in the package robot_descriptions; a path that ends in ``.urdf``, ``.xacro``
            or ``.xml``; the text of a URDF; or a model of yourdfpy, pinocchio or MuJoCo.
        base: Name of the base link; the default is the arm's own, or the root of the file.
        tip: Name of the link whose pose is computed; the default is the arm's own, or the only leaf.
        args: Values of a xacro file's arguments, by name.
        packages: Folders of ROS packages for a xacro file, by name.
        trusted: Whether Python may evaluate the expressions of a xacro file.
        calibration: Measured origins of joints, as in `kinseek.load`.
        srdf: An SRDF file, or its text, as in `kinseek.load`.
        group: Name of a group of the SRDF.
        limits: As in `kinseek.load`.

    Raises:
        InvalidRobot: The source is none of these, or it cannot be used.
        MissingExtra: The source is an MJCF file, and MuJoCo is not installed.
    """
    _require_names(base, tip)
    _require_mappings(args, packages)
    trusted = as_flag("trusted", trusted, InvalidRobot)
    _require_group(srdf, group)
    limits_file, ranges = _limits(limits)
    of_urdf = {"calibration": calibration, "srdf": srdf, "limits": limits_file}
    changed = [name for name, value in of_urdf.items() if value is not None]
    plain = base is None and tip is None and not (changed or args or packages)
    if plain and _is_bundled(source) and (bundled := read_bundled(source)) is not None:
        return bundled if ranges is None else with_limits(bundled, ranges)
    found = _find(source, args, packages, trusted)
    if not isinstance(found, Urdf):
        if changed:
            raise InvalidRobot(
                f"{changed[0]}{' of a file' * (changed[0] == 'limits')} is for a URDF, and this source is none; expected a "
                "bundled arm, a .urdf or .xacro file, or the text of a URDF"
            )
        chain = _read_mjcf(found, base, tip) if isinstance(found, Path) else _read_model(found, base, tip)
        return chain if ranges is None else with_limits(chain, ranges)
    if calibration is not None:
        from .calibration import calibrated

        found = calibrated(found, calibration)
    found = found._replace(limits=ranges or {})
    variables: dict[str, dict[str, float]] = {}
    if limits_file is not None:
        from .joint_limits import limited

        found, variables = limited(found, limits_file)
    if srdf is not None:
        from .groups import arm_of_group
        from .srdf import read_srdf

        chain = arm_of_group(found, base, tip, read_srdf(srdf, packages, trusted), group)
    else:
        chain = found.arm(found.base if base is None else base, found.tip if tip is None else tip)
    if variables:
        from .joint_limits import with_variables

        chain = with_variables(chain, variables)
    return chain if ranges is None else with_limits(chain, ranges)


def _limits(limits: Any) -> tuple[str | os.PathLike[str] | None, Limits | None]:
    """Return the path of a file of limits, or limits by name, or neither.

    Raises:
        InvalidRobot: The argument is anything else.
    """
    if isinstance(limits, str | os.PathLike):
        return limits, None
    if isinstance(limits, Mapping | None):
        return None, limits
    raise InvalidRobot(
        "limits must be a mapping from names of joints to pairs, or the path of a joint_limits.yaml of MoveIt, got "
        f"{limits!r:.80}"
    )


def _find(
    source: Any,
    args: Mapping[str, Any] | None,
    packages: Mapping[str, str | Path] | None,
    trusted: bool,
) -> Any:
    """Return the URDF of a source, the path of an MJCF file, or the source itself if it is anything but text or a path.

    Raises:
        InvalidRobot: There is nothing of that name, or it cannot be read.
    """
    if not isinstance(source, str | os.PathLike) or is_text(source):
        _refuse_options(args, packages, "what is no file")
        return urdf_of_text(source) if is_text(source) else urdf_of_model(source) or source
    path = _path(source)
    if path.suffix.lower() == ".xacro":
        return urdf_of_file(path, args=args, packages=packages, trusted=trusted)
    _refuse_options(args, packages, repr(str(source)))
    if _is_bundled(source):
        entry, path = catalog_entry(str(source)), catalog_path(str(source))
        return urdf_of_file(path)._replace(base=entry.base, tip=entry.tip)
    if is_described(source):
        return described(str(source), trusted)
    if path.suffix.lower() == ".urdf" or (path.suffix.lower() == ".xml" and _is_urdf(path)):
        return urdf_of_file(path)
    if path.suffix.lower() == ".xml":
        return path
    raise InvalidRobot(_what_it_may_be(str(source)))


def _is_bundled(source: Any) -> bool:
    return isinstance(source, str) and source in catalog_names()


def _read_mjcf(path: Path, base: str | None, tip: str | None) -> SerialChain:
    from .mjcf import read_mjcf

    return read_mjcf(path, base, tip)


def _read_model(source: Any, base: str | None, tip: str | None) -> SerialChain:
    if (chain := read_model_of_library(source, base, tip)) is not None:
        return chain
    kind = type(source)
    package = kind.__module__.partition(".")[0]
    known = package not in ("builtins", "__main__", "kinseek")
    what = f"{kind.__module__}.{kind.__qualname__}" if known else kind.__name__
    hint = "; give the file that it was read from" if known else ""
    hint = "; it is an arm already" if package == "kinseek" else hint
    raise InvalidRobot(
        f"source must be the name of a bundled arm, a path to a {ANY_ENDING} file, the text of a URDF, or a model "
        f"of yourdfpy, pinocchio or MuJoCo, got {what}{hint}. Bundled: {', '.join(catalog_names())}"
    )


def _path(source: str | os.PathLike[str]) -> Path:
    if isinstance(os.fspath(source), bytes):
        raise InvalidRobot(f"source must be a path as text, got bytes: {os.fspath(source)!r}")
    scheme, address, _ = str(source).partition("://")
    if address and "<" not in scheme:
        raise InvalidRobot(
            f"{str(source)!r}: URLs are not supported; give the path of the file, without {scheme}://"
        )
    return home_path(source)


def _what_it_may_be(source: str) -> str:
    """Describe a source that is neither a name nor a path, with suggestions."""
    if hint := hint_at(source):
        shown = repr(source if len(source) <= 60 else f"{source[:60]}…")
        return f"no arm is called {shown}; {hint}. A path must end in {ANY_ENDING}"
    if found := instead_of_a_description(Path(source)):
        return f"{source!r} is {found}; expected the path of a {ANY_ENDING} file"
    plain = {_plain(name): name for name in catalog_names()}
    if (meant := plain.get(_plain(source))) is not None:
        return f"unknown robot {source!r}; did you mean {meant!r}? Names of bundled arms are lower-case"
    return f"{suggest(source, catalog_names(), 'robot')}. A path must end in {ANY_ENDING}"


def _plain(name: str) -> str:
    return re.sub(r"[^a-z0-9]", "", name.lower())


def _refuse_options(args: object, packages: object, source: str) -> None:
    if args or packages:
        raise InvalidRobot(f"args and packages are for .xacro files, got {source}")


def _require_group(srdf: object, group: object) -> None:
    if group is None:
        return
    if not isinstance(group, str):
        raise InvalidRobot(f"group must be the name of a group of the SRDF, got {group!r:.80}")
    if srdf is None:
        raise InvalidRobot(f"group={group!r} names a group of an SRDF; give the SRDF too, srdf=...")


def as_mechanism(value: Any) -> Mechanism:
    """Return a chain or black-box mechanism as `kinseek.Arm` takes it.

    Raises:
        InvalidRobot: The value is a name, a file, an arm or anything else.
    """
    if isinstance(value, SerialChain | BlackBox):
        return value
    if isinstance(value, str | os.PathLike):
        raise InvalidRobot(f"Arm takes a SerialChain, got {value!r}; write kinseek.load({value!r})")
    if isinstance(getattr(value, "mechanism", None), SerialChain | BlackBox):
        raise InvalidRobot("Arm takes a SerialChain, got an Arm, which can be used as it is")
    raise InvalidRobot(f"Arm takes a SerialChain, got {type(value).__name__}. Ways to make an arm: {MAKERS}")


def _require_names(base: object, tip: object) -> None:
    for name, value in (("base", base), ("tip", tip)):
        if value is not None and not isinstance(value, str):
            raise InvalidRobot(
                f"{name} must be the name of a link, got {value!r:.80} ({type(value).__name__})"
            )


def _require_mappings(args: object, packages: object) -> None:
    if not isinstance(args, Mapping | None):
        raise InvalidRobot(f"args must be a mapping from names to values, got {args!r:.80}")
    if not isinstance(packages, Mapping | None) or not all(
        isinstance(folder, str | os.PathLike) for folder in (packages or {}).values()
    ):
        raise InvalidRobot(f"packages must be a mapping from names to folders, got {packages!r:.80}")


def _is_urdf(path: Path) -> bool:
    """Return whether an .xml file holds a URDF robot; broken XML counts as MJCF, so that MuJoCo explains the error."""
    from .files import file_bytes
    from .xml_files import root_element

    try:
        root = root_element(file_bytes(path), str(path))
    except InvalidRobot:
        return False
    return bool(root.tag.endswith("robot"))
