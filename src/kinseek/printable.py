"""Names from files made safe to print: no character acts on a terminal or stays invisible in a line."""

from __future__ import annotations

_MARKUP = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;", "'": "&#x27;"})
"""What `html.escape` replaces. Importing `html` takes a millisecond, for a table of two thousand entities."""


def printable(text: str, keep: str = "") -> str:
    r"""Escape every character that acts on a terminal or is invisible, as `repr` does.

    These are the Unicode categories C* (control, format such as U+202E, surrogate, private use, unassigned) and all
    separators except the space. Backslashes stay as they are, so the result is for display and cannot be parsed back.

    Args:
        text: A name from a file, or a line with such names.
        keep: Characters that stay, such as the line breaks between the lines of a table.
    """
    if text.isprintable():
        return text
    return "".join(
        letter if letter.isprintable() or letter in keep else letter.encode("unicode_escape").decode()
        for letter in text
    )


def in_html(text: str) -> str:
    """Escape text as `printable` does, and for HTML: no tag and no entity remains."""
    return printable(text).translate(_MARKUP)
