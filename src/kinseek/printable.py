"""Names from files made safe to print: no character acts on a terminal or is invisible."""

from __future__ import annotations

_INVISIBLE = frozenset(
    map(
        chr,
        (
            *(0x034F, 0x115F, 0x1160, 0x17B4, 0x17B5, 0x180B, 0x180C, 0x180D, 0x180F, 0x2800, 0x3164, 0xFFA0),
            *range(0xFE00, 0xFE10),
            *range(0xE0100, 0xE01F0),
        ),
    )
)
"""Letters and marks without a shape: of *Unicode 15, DerivedCoreProperties.txt* those with Default_Ignorable_Code_Point that
Python calls printable, and the empty pattern of Braille. With them, different names look the same."""

_MARKUP = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#x27;"})
"""What `html.escape` replaces. Importing `html` takes a millisecond, for a table of two thousand entities."""


def printable(text: str, keep: str = "") -> str:
    r"""Escape every character that acts on a terminal or is invisible, as `repr` does.

    These are the Unicode categories C* (control, format such as U+202E, surrogate, private use, unassigned), all
    separators except the space, and letters and marks without a shape, such as U+3164. Backslashes stay as they are, so
    the result is for display and cannot be parsed back.

    Args:
        text: A name from a file, or a line with such names.
        keep: Characters that stay, such as the line breaks between the lines of a table.
    """
    if text.isprintable() and (text.isascii() or _INVISIBLE.isdisjoint(text)):
        return text
    return "".join(
        letter
        if letter in keep or (letter.isprintable() and letter not in _INVISIBLE)
        else letter.encode("unicode_escape").decode()
        for letter in text
    )


def in_html(text: str) -> str:
    """Escape text as `printable` does, and for HTML: no tag and no entity remains."""
    return printable(text).translate(_MARKUP)
