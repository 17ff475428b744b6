"""Read the text of a URDF, models of other libraries, and robots of the package robot_descriptions.

A model is recognised by the module of its class, so none of these libraries is imported or required.
"""

from __future__ import annotations

import importlib
import re
from pathlib import Path
from typing import Any

from kinseek.errors import InvalidRobot, near_names
from kinseek.support.forks import importing
from kinseek.support.interrupts import raise_of_handler

from .chain import SerialChain
from .urdf import Urdf, urdf_of_file

_DECLARATION = re.compile(r"^\s*<\?xml[^>]*\?>")
"""XML declaration. It names an encoding, which no longer applies to decoded text."""
_DESCRIPTION = "_description"


def is_text(source: object) -> bool:
    """Return whether a source is the text of an XML file rather than a name or a path."""
    if isinstance(source, bytes):
        return source.lstrip()[:1] == b"<"
    return isinstance(source, str) and source.lstrip("\ufeff \t\r\n").startswith("<")


def urdf_of_text(text: str | bytes) -> Urdf:
    """Return the URDF of a text.

    Raises:
        InvalidRobot: It is the text of an MJCF file.
    """
    if isinstance(text, str):
        text = _DECLARATION.sub("", text.lstrip("\ufeff")).encode()
    if b"<mujoco" in text[:4096] and b"<robot" not in text[:4096]:
        raise InvalidRobot(
            "this is the text of an MJCF file: give its path, or the model, mujoco.MjModel.from_xml_string(text)"
        )
    return Urdf(text.lstrip(), "the URDF text")


def urdf_of_model(source: Any) -> Urdf | None:
    """Return the URDF of a model of yourdfpy or urdf_parser_py; None for anything else."""
    packages = _packages(source)
    if "yourdfpy" in packages and hasattr(source, "write_xml_string"):
        return Urdf(_text_of_yourdfpy(source), "the yourdfpy model")
    if "urdf_parser_py" in packages and hasattr(source, "to_xml_string"):
        return Urdf(source.to_xml_string().encode(), "the urdf_parser_py model")
    return None


def read_model_of_library(source: Any, base: str | None, tip: str | None) -> SerialChain | None:
    """Read a model of pinocchio or MuJoCo; return None for anything else.

    Raises:
        InvalidRobot: The model cannot be used.
    """
    packages = _packages(source)
    if "pinocchio" in packages:
        from .pinocchio_model import read_pinocchio

        model = getattr(source, "model", source)  # A RobotWrapper holds its model.
        return read_pinocchio(model, base, tip) if hasattr(model, "jointPlacements") else None
    if "mujoco" in packages and hasattr(source, "body_parentid"):
        from .mjcf import read_model

        return read_model(source, base, tip, where="the MuJoCo model")
    return None


def _packages(source: Any) -> set[str]:
    return {kind.__module__.partition(".")[0] for kind in type(source).__mro__}


def _text_of_yourdfpy(model: Any) -> bytes:
    """Write a model of yourdfpy as URDF; yourdfpy's own writer omits mimic joints and soft limits."""
    with importing:
        from lxml import etree

    root = etree.fromstring(model.write_xml_string())
    for element, joint in zip(root.iterfind("joint"), model.robot.joints, strict=True):
        if joint.mimic is not None and element.find("mimic") is None:
            law = {
                "multiplier": repr(float(joint.mimic.multiplier)),
                "offset": repr(float(joint.mimic.offset)),
            }
            etree.SubElement(element, "mimic", joint=joint.mimic.joint, **law)
        safety = joint.safety_controller
        if safety is not None and element.find("safety_controller") is None:
            soft = {name: getattr(safety, name) for name in ("soft_lower_limit", "soft_upper_limit")}
            given = {name: repr(float(value)) for name, value in soft.items() if value is not None}
            etree.SubElement(element, "safety_controller", given)
    return bytes(etree.tostring(root))


def is_described(name: object) -> bool:
    """Return whether a name has the form of the names in robot_descriptions."""
    return isinstance(name, str) and name.isidentifier() and name.endswith(_DESCRIPTION)


def described(name: str, trusted: bool) -> Urdf | Path:
    """Return a robot of the package robot_descriptions, which downloads its files at the first request.

    Args:
        name: Its name there.
        trusted: Whether Python may evaluate the expressions of a xacro file.

    Returns:
        Its URDF, or the path of its MJCF file if it has no URDF.

    Raises:
        InvalidRobot: The package is not installed, has no such robot, or cannot download it; or the file cannot be read.
    """
    try:
        known = importlib.import_module("robot_descriptions").DESCRIPTIONS
    except ImportError:
        raise InvalidRobot(
            f"{name!r} is not a bundled arm. It may be a name of the package robot_descriptions, which is not "
            "installed: pip install robot_descriptions"
        ) from None
    if name not in known:
        near = near_names(name, known)
        hint = f"; did you mean {' or '.join(map(repr, near))}?" if near else ""
        raise InvalidRobot(f"robot_descriptions has no {name!r}{hint}")
    try:
        module = importlib.import_module(f"robot_descriptions.{name}")
    except Exception as error:  # Downloading over the network may raise anything.
        raise_of_handler(error)
        raise InvalidRobot(
            f"robot_descriptions cannot fetch {name!r}: {type(error).__name__}: {error}"
        ) from error
    if path := getattr(module, "URDF_PATH", None):
        return urdf_of_file(path)
    if path := getattr(module, "XACRO_PATH", None):
        return urdf_of_file(path, args=getattr(module, "XACRO_ARGS", None), trusted=trusted)
    return Path(module.MJCF_PATH)


def hint_at(source: str) -> str:
    """Return a hint at what may be wrong with a name or a path; "" if none is known."""
    if "<robot" in source:
        return "this is the text of a robot in a path: give the text itself, as a str"
    if "\n" in source:
        return f"this is text of {len(source):,} letters and no path; the text of a robot begins with <robot"
    if Path(source).suffix.lower() in (".sdf", ".usd", ".usda", ".step", ".stp", ".stl", ".dae"):
        return f"{Path(source).suffix} files are not read: export the arm as URDF or MJCF"
    return ""
