"""The materials of COLLADA. What cannot be read of them is left out: they change no shape.

Source: Barnes and Levy Finch, *COLLADA – Digital Asset Schema Release 1.4.1*, Khronos Group (2008), chapter 8.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any
from urllib.parse import unquote

import numpy as np

from kinseek.errors import InvalidRobot

from .collada_geometry import name_of, numbers_of
from .polygons import Array, Looks

_SHADERS = ("phong", "lambert", "blinn", "constant")


def looks_of(names: Iterable[str], named: dict[str, list[Any]]) -> Looks:
    """Return the materials of these ids.

    Args:
        names: Ids of the materials; those that do not exist are left out.
        named: All elements by their ids.
    """
    looks, known = Looks(), dict[Any, dict[str, Any]]()
    for name in sorted(names):
        material = _named("material", name, named)
        url = None if material is None else material.find("{*}instance_effect")
        effect = None if url is None else _named("effect", url.get("url", "").removeprefix("#"), named)
        if effect is None:
            continue
        if effect not in known:  # It is read once, however many materials refer to it.
            known[effect] = _look(effect, named)
        if known[effect]:
            looks[name] = known[effect]
    return looks


def _look(effect: Any, named: dict[str, list[Any]]) -> dict[str, Any]:
    """Return the arguments of trimesh's material for an effect; none if it has no shader."""
    if (shader := _shader(effect)) is None:
        return {}
    colour, emission = _colour(shader, "diffuse"), _colour(shader, "emission")
    transparent, shininess = _colour(shader, "transparent"), shader.find("{*}shininess/{*}float")
    base = np.ones(4) if colour is None else colour
    if transparent is not None:
        base = np.array([*base[:3], transparent[3]])
    roughness = 1.0
    with suppress(InvalidRobot):
        if (
            shininess is not None
            and len(exponent := numbers_of(shininess, "a material")) == 1
            and exponent[0] >= 0
        ):
            # Of a highlight as wide as that of Phong's exponent.
            roughness = float(np.sqrt(2 / (2 + exponent[0])))
    look: dict[str, Any] = {"baseColorFactor": base, "metallicFactor": 0.0, "roughnessFactor": roughness}
    if emission is not None:
        look["emissiveFactor"] = emission[:3]
    for key, part in (("baseColorTexture", "diffuse"), ("emissiveTexture", "emission")):
        if image := _image(shader, part, effect, named):
            look[key] = image
    return look


def _named(kind: str, name: str, named: dict[str, list[Any]]) -> Any:
    """Return the only element of a kind with this id; None if there are others."""
    found = [each for each in named.get(name, []) if name_of(each) == kind]
    return found[0] if len(found) == 1 else None


def _shader(effect: Any) -> Any:
    found = (effect.find(f"{{*}}profile_COMMON/{{*}}technique/{{*}}{each}") for each in _SHADERS)
    return next((each for each in found if each is not None), None)


def _colour(shader: Any, part: str) -> Array | None:
    """Return the colour of a part of a shader, red, green, blue and opacity from 0 to 1, (4,)."""
    element = shader.find(f"{{*}}{part}/{{*}}color")
    with suppress(InvalidRobot):
        if element is not None and len(found := numbers_of(element, "a material")) in (3, 4):
            return np.minimum(np.maximum([*found, 1.0][:4], 0.0), 1.0)
    return None


def _image(shader: Any, part: str, effect: Any, named: dict[str, list[Any]]) -> str | None:
    """Return the name of the file of the image of a part of a shader.

    A texture refers to a sampler, this to a surface, and this to an image; version 1.5 has no surfaces, and some files refer
    to the image at once.
    """
    texture = shader.find(f"{{*}}{part}/{{*}}texture")
    if texture is None:
        return None
    params = {each.get("sid"): each for each in effect.iter("{*}newparam")}
    name = texture.get("texture", "")
    for path in ("{*}sampler2D/{*}source", "{*}surface/{*}init_from"):
        found = None if name not in params else params[name].find(path)
        name = name if found is None else (found.text or "").strip()
    image = _named("image", name, named)
    found = None if image is None else image.find("{*}init_from")
    return None if found is None else unquote((found.text or "").strip()) or None
