"""Limits that mesh files of all formats share: of the files beside them, and of all meshes of a robot together.

Each reader adds up the sizes that a file declares before it reads anything: a few bytes must not become gigabytes.
"""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import prod
from pathlib import Path
from typing import Any, NamedTuple

from kinseek.errors import InvalidRobot
from kinseek.robots.files import file_bytes, without_links
from kinseek.support.forks import importing
from kinseek.support.interrupts import raise_of_handler

ENDINGS = ("dae", "glb", "obj", "ply", "stl")
"""Extensions of the formats that are read, without the dot."""
MOST_BODIES = 10_000
"""Most bodies of one file: each takes some kilobytes, however few triangles it has."""
MOST_HINTS = 20
"""See `Budget.hints_left`."""
LEAST_BODIES = 4
"""Least number of bodies that a file counts as, in the budget of a robot: reading a file takes as long as some eight
bodies."""
MOST_UNPACKED = 2**31
"""Most bytes of all bodies that another process has read, see `process`, with their images."""
MOST_REPEATED = 2**26
"""Most bytes of files that are read again because a robot refers to them more than once."""
MOST_NAMES = 1_000
"""Most references of a mesh to other files; two references to one file count twice."""
MOST_PIXELS = 2**26
"""Most pixels of all images of one file together."""
MOST_COPIED = 2**27
"""Most pixels of the images of all bodies together: each body has a copy of its images."""
MOST_LINE = 2**16
"""Most bytes of a line of OBJ and PLY: no polygon needs more."""
MOST_LINES = 2**22
"""Most lines of OBJ and text PLY, and vertices with normals and solids of text STL. An empty line takes as much memory as a
full one."""
MOST_CORNERS = 3 * 2**22
"""Most triangle corners of COLLADA and GLB, with each instance counted, and of all meshes of a robot. Larger meshes can be
read as binary STL or PLY."""
MOST_TRIED = 2**26
"""Most corners of polygons that are not convex, of all meshes of a robot, added up each time that another of their corners
is tried: 2²⁶ take half a minute."""

_BREAK = re.compile(rb"\r(?!\n)|[\0\v\f]")
_LINE_ENDS = [each.encode() for each in "\n\r\v\f\x1c\x1d\x1e\x85\u2028\u2029"]
"""Where trimesh divides a file of materials, by `str.splitlines`."""

_IMAGES_OF = (
    "image",
    "baseColorTexture",
    "emissiveTexture",
    "metallicRoughnessTexture",
    "normalTexture",
    "occlusionTexture",
)
"""Attributes of a trimesh material that hold images."""
_IMAGES = ("BMP", "JPEG", "PNG", "WEBP")
"""Image formats that are decoded: textures seldom have another one, and the readers of some start programs."""


def utf8(text: bytes) -> bytes:
    """Return UTF-8 without a byte order mark, which would hide the first keyword; convert anything else from Latin-1."""
    try:
        text.decode()
    except UnicodeDecodeError:
        return text.decode("latin-1").encode()
    return text.removeprefix(codecs.BOM_UTF8)


def require_line_ends(text: bytes) -> None:
    """Reject what ends a line for some readers alone; lines end with LF or CR LF here.

    Raises:
        InvalidRobot: The text has such a character.
    """
    if found := _BREAK.search(text):
        raise InvalidRobot(
            f"it has the character {found[0].decode()!r}, which is a line end to some readers; end lines with '\\n'"
        )


def ending(path: Path) -> str:
    """Return the extension of a mesh file, without the dot.

    Raises:
        InvalidRobot: The extension is not supported.
    """
    found = path.suffix[1:].lower()
    if found not in ENDINGS:
        *first, last = (f".{each}" for each in ENDINGS)
        raise InvalidRobot(
            f"{str(path)!r} is not read as a mesh: the name must end in {', '.join(first)} or {last}"
        )
    return found


def at_most(count: int, most: int, noun: str) -> None:
    """Reject more of something than a mesh may have."""
    if count > most:
        raise InvalidRobot(f"{count:,} {noun}, expected at most {most:,}: a mesh of an arm is smaller")


class Size(NamedTuple):
    """Size of a file's unpacked content."""

    bodies: int
    corners: int
    """Corners of triangles; lines and values of text formats count as corners. Zero for binary STL and PLY, whose bytes
    count."""
    tried: int = 0
    """Corners of polygons that are not convex, each time that another of their corners is tried."""

    @classmethod
    def of(cls, sizes: Sequence[Size]) -> Size:
        """Return the sum of sizes."""
        return cls(*(sum(column) for column in zip((0, 0, 0), *sizes, strict=True)))


@dataclass
class Budget:
    """Remaining budget of all meshes of one robot, or of one file of obstacles."""

    bytes_left: int
    """Bytes of files: meshes, materials and images."""
    pixels_left: int = MOST_COPIED
    """Pixels of the images of all bodies."""
    bodies_left: int = MOST_BODIES
    """Number of bodies; a file counts as at least `LEAST_BODIES`."""
    corners_left: int = MOST_CORNERS
    tried_left: int = MOST_TRIED
    unpacked_left: int = MOST_UNPACKED
    """Bytes of bodies that another process has read, with their images."""
    repeated_left: int = MOST_REPEATED
    """Bytes of files that were read before."""
    hints_left: int = MOST_HINTS
    """Number of missing files for which a message says what may be meant."""
    seen: set[str] = field(default_factory=set)
    """Files that were read, as texts: the budget goes to a process and back for each file, and pickling paths is slow."""
    refused: dict[str, str] = field(default_factory=dict)
    """Meshes that were rejected, with the reason; they are not read again."""

    def read(self, path: Path, most: int, below: Path | None = None) -> bytes:
        """Read a file of at most `most` bytes, in a folder out of which no link may lead.

        Raises:
            InvalidRobot: The file cannot be read or is too large, or the budget is exhausted.
        """
        if min(self.bytes_left, self.repeated_left) >= 0:
            self.hints_left -= 1
            text = file_bytes(path, most, below=below, hints=self.hints_left >= 0)
            self.hints_left += 1
            self.bytes_left -= len(text)
            real = str(without_links(path))
            self.repeated_left -= len(text) if real in self.seen else 0
            self.seen.add(real)
        if min(self.bytes_left, self.repeated_left) < 0:
            raise InvalidRobot(
                f"{str(path)!r} is not read: the files before it and this one are too large together"
            )
        return text

    def take(self, size: Size) -> None:
        """Subtract the unpacked size of a file, before it is unpacked; or work on it, before it is done.

        Raises:
            InvalidRobot: The budget is exhausted.
        """
        self.bodies_left -= size.bodies
        self.corners_left -= size.corners
        self.tried_left -= size.tried
        if min(self.bodies_left, self.corners_left) < 0:
            raise InvalidRobot("the meshes before it and this one have too many bodies or triangles together")
        if self.tried_left < 0:
            raise InvalidRobot(
                "the meshes before it and this one have too many corners in polygons that are not convex; write them as "
                "triangles"
            )

    def take_unpacked(self, size: int) -> None:
        """Subtract the bytes of bodies that another process has read.

        Raises:
            InvalidRobot: The budget is exhausted.
        """
        at_most(size, self.unpacked_left, "bytes of bodies with their images and names")
        self.unpacked_left -= size

    def take_images(self, bodies: Iterable[Any]) -> None:
        """Subtract the pixels of the images of bodies; an image counts for each body that has it.

        Raises:
            InvalidRobot: The images have too many pixels.
        """
        pixels = sum(_pixels_of(getattr(each, "visual", None)) for each in bodies)
        at_most(pixels, self.pixels_left, "pixels in the images of its bodies")
        self.pixels_left -= pixels


def _pixels_of(visual: Any) -> int:
    """Return the number of pixels of a body's images, without decoding them."""
    images = (getattr(getattr(visual, "material", None), name, None) for name in _IMAGES_OF)
    return sum(prod(image.size) for image in images if image is not None)


class Beside:
    """Files that a mesh refers to, materials and images: in its folder or below, with the limits of a mesh together."""

    def __init__(self, path: Path, most: int, budget: Budget) -> None:
        """Search beside this file, with at most `most` bytes and the rest of the budget."""
        self.file_name, self._budget = path.name, budget
        self._folder, self._left = without_links(path.parent), most
        self._pixels = self._names = self._lines = self._materials = 0

    def get(self, name: str) -> bytes:
        """Read one of the files.

        Raises:
            InvalidRobot: The file is elsewhere, is not a regular file, or is too large; or there were too many references
                before.
        """
        self._names += 1
        at_most(self._names, MOST_NAMES, "names of other files")
        self._require_few_materials()  # Otherwise each further file would be read before it is rejected.
        named = name.strip().replace("\\", "/")
        last = named.rpartition("/")[2]
        # Windows would connect to another machine for a name such as //server/share/file.
        names = (last,) if named.startswith("//") else (named, last)
        try:
            places = [(self._folder / each).resolve() for each in names]
            found = next(
                (each for each in places if each.is_relative_to(self._folder) and each.is_file()), None
            )
        except (OSError, RuntimeError, ValueError):  # It is too long for a name, or a link leads to itself.
            found = None
        if found is None:
            raise InvalidRobot(f"{name!r} is neither in {str(self._folder)!r} nor in a folder below")
        text = self._budget.read(found, self._left, self._folder)
        self._left -= len(text)
        pixels = pixels_of_image(text)
        self._pixels += pixels
        at_most(self._pixels, MOST_PIXELS, "pixels in its images")
        if not pixels:
            lines = utf8(text)
            self._lines += sum(map(lines.count, _LINE_ENDS)) - lines.count(b"\r\n") + 1
            self._materials += lines.lower().count(b"newmtl")
            self._require_few_materials()
        # As it is: without its byte order mark, the file may be an image whose format is not decoded.
        return text

    def image(self, source: str | bytes) -> Any:
        """Decode an image, given as its bytes or as the name of its file.

        Raises:
            InvalidRobot: As `get`; or it is no image that can be read.
        """
        text = self.get(source) if isinstance(source, str) else source
        if not pixels_of_image(text):
            raise InvalidRobot("it is not an image that can be read")
        from PIL import Image

        try:
            image = Image.open(io.BytesIO(text), formats=_IMAGES)
            image.load()
        except Exception as error:  # It is broken, in whatever way its format knows.
            raise_of_handler(error)
            raise InvalidRobot(f"an image cannot be read: {error}") from None
        return image

    def _require_few_materials(self) -> None:
        at_most(self._lines, MOST_LINES, "lines of materials")
        at_most(self._materials, MOST_BODIES, "materials")

    __getitem__ = get


def pixels_of_image(text: bytes) -> int:
    """Return the number of pixels of an image, without decoding it; 0 for anything else.

    Raises:
        InvalidRobot: The image cannot be read, or its format is not supported because its reader does more than decode.
    """
    try:
        with importing:
            from PIL import Image, UnidentifiedImageError
    except ImportError:  # Without Pillow, trimesh reads no images.
        return 0
    try:
        with Image.open(io.BytesIO(text), formats=_formats_to_try(text)) as image:
            known, count = str(image.format), prod(image.size)
    except UnidentifiedImageError:
        return 0
    except InvalidRobot:
        raise
    except Exception as error:  # The image is too large for Pillow, or broken.
        raise_of_handler(error)
        raise InvalidRobot(f"an image cannot be read: {error}") from None
    _require_image_format(known)
    return count


def _formats_to_try(text: bytes) -> list[str]:
    """Return the image formats as which a file is opened: those that are decoded, and those without a mark at the beginning.

    Raises:
        InvalidRobot: The file begins like one of another format. It is not opened: Pillow decodes some, such as ICO, then.
    """
    from PIL import Image

    Image.init()
    begins = {name: accepts for name, (_, accepts) in Image.OPEN.items()}
    for name, accepts in begins.items():
        if name not in _IMAGES and accepts is not None and len(text) >= 16 and accepts(text[:16]) is True:
            _require_image_format(name)
    return [name for name, accepts in begins.items() if name in _IMAGES or accepts is None]


def _require_image_format(name: str) -> None:
    if name not in _IMAGES:
        raise InvalidRobot(f"an image is {name}, expected one of {', '.join(_IMAGES)}")


def drawn_corners(corners: int, text: bytes) -> int:
    """Count corners; those beyond three per byte of the file count four times, since only instances create so many."""
    counted = corners + 3 * max(0, corners - 3 * len(text))
    at_most(counted, MOST_CORNERS, "corners of triangles, with those of instances counted four times")
    return counted
