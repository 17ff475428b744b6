"""The materials, colours and normals of GLB. What cannot be read of them is left out: they change no shape.

Source: *glTF 2.0 Specification*, Khronos Group (2021), to whose sections the numbers refer.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from typing import Any

import numpy as np

from kinseek.errors import InvalidRobot

from .glb_file import GlbFile, Json, entry, whole
from .limits import MOST_BODIES, MOST_PIXELS, at_most, pixels_of_image
from .polygons import Array, Body, Indices, Looks

_FACTORS = {
    "baseColorFactor": 4,
    "emissiveFactor": 3,
    "metallicFactor": 0,
    "roughnessFactor": 0,
    "alphaCutoff": 0,
}
"""Numbers of materials, and how many each has; 0 for one that is not in a list."""
_TEXTURES = (
    "baseColorTexture",
    "metallicRoughnessTexture",
    "emissiveTexture",
    "normalTexture",
    "occlusionTexture",
)
_ALPHA_MODES = ("OPAQUE", "MASK", "BLEND")


def painted(body: Body, used: Indices, described: Json, file: GlbFile) -> Body:
    """Return a body with its looks (3.7.2.1).

    Args:
        body: The body.
        used: Its vertices, as numbers of those of its primitive, (n,).
        described: Its primitive.
        file: The file.
    """
    colours = _attribute("COLOR_0", ("VEC3", "VEC4"), used, described, file)
    uv = _attribute("TEXCOORD_0", ("VEC2",), used, described, file)
    if uv is not None:
        uv = uv * (1, -1) + (
            0,
            1,
        )  # The origin of an image is its upper left corner (3.8.3), to trimesh the lower one.
    material = ""
    with suppress(InvalidRobot):
        material = str(whole(described, "material"))
    return body._replace(
        vertex_colours=None if colours is None else np.rint(255 * np.clip(colours, 0, 1)).astype(np.uint8),
        material=material,
        uv=uv,
        normals=_attribute("NORMAL", ("VEC3",), used, described, file),
    )


def _attribute(
    name: str, types: tuple[str, ...], rows: Indices, described: Json, file: GlbFile
) -> Array | None:
    """Return some rows of an attribute, with whole numbers as those from 0 to 1 that they stand for (3.6.2.2)."""
    with suppress(InvalidRobot):
        accessor = file.element("accessors", whole(entry(described, "attributes"), name))
        found, is_normalized = file.numbers(accessor), accessor.get("normalized", False)
        kind = found.dtype.kind
        fits = accessor["type"] in types and (kind, is_normalized) in (("f", False), ("u", True))
        if fits and rows.max() < len(found):
            values = found[rows].astype(np.float64) / (np.iinfo(found.dtype).max if is_normalized else 1)
            return values if np.isfinite(values).all() else None
    return None


def looks_of(file: GlbFile, names: Iterable[str], size: int) -> Looks:
    """Return the materials of these numbers (3.9), with the bytes of their images.

    Args:
        file: The file.
        names: Numbers of materials; those that do not exist are left out.
        size: Bytes of the file.

    Raises:
        InvalidRobot: Their images are too large.
    """
    looks, images = Looks(), dict[int, memoryview]()
    for name in sorted({*names} - {""}):
        with suppress(InvalidRobot):
            looks[name] = _look(file.element("materials", int(name)), file, images)
    at_most(len(images), MOST_BODIES, "images")
    at_most(sum(map(len, images.values())), 2 * size, "bytes in its images")
    content = {number: bytes(image) for number, image in images.items()}
    at_most(sum(map(_pixels, content.values())), MOST_PIXELS, "pixels in its images")
    for look in looks.values():
        look |= {key: content[look[key]] for key in _TEXTURES if key in look}
    return looks


def _look(material: Json, file: GlbFile, images: dict[int, memoryview]) -> dict[str, Any]:
    """Return the arguments of trimesh's material, with numbers of images, which are added to `images`."""
    given = dict(material)
    with suppress(InvalidRobot):
        given |= entry(material, "pbrMetallicRoughness")
    look = dict[str, Any]()
    for key, count in _FACTORS.items():
        numbers: Any = given.get(key) if count else [given.get(key)]
        fits = isinstance(numbers, list) and len(numbers) == (count or 1)
        if fits and all(type(x) in (int, float) and 0 <= x <= 1 for x in numbers):
            look[key] = np.array(numbers, np.float64) if count else float(numbers[0])
    if given.get("alphaMode") in _ALPHA_MODES:
        look["alphaMode"] = given["alphaMode"]
    if isinstance(given.get("doubleSided"), bool):
        look["doubleSided"] = given["doubleSided"]
    for key in _TEXTURES:
        with suppress(InvalidRobot):
            number = _image(entry(given, key), file)
            if number not in images:
                images[number] = file.view(
                    file.element("bufferViews", whole(file.element("images", number), "bufferView"))
                )
            look[key] = number
    return look


def _image(info: Json, file: GlbFile) -> int:
    """Return the number of the image of a texture (3.8).

    Raises:
        InvalidRobot: There is none, or its places are others than those that are read.
    """
    if whole(info, "texCoord", 0) != 0:
        raise InvalidRobot("its texture has coordinates of its own")
    texture = file.element("textures", whole(info, "index"))
    webp = entry(entry(texture, "extensions"), "EXT_texture_webp")
    return whole(webp if "source" in webp else texture, "source")


def _pixels(image: bytes) -> int:
    """Return the number of pixels of an image; 0 if it cannot be read, for then it is left out."""
    with suppress(InvalidRobot):
        return pixels_of_image(image)
    return 0
