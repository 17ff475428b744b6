"""Names from files, as people may see them: no character of them acts on a terminal or hides in a line."""

from __future__ import annotations

import html


def printable(text: str, keep: str = "") -> str:
    r"""Escape every character that a terminal would act on or that nobody would see, as `repr` does.

    These are the Unicode categories C* (control, format such as U+202E, surrogate, private use, unassigned) and all
    separators except the space. Backslashes stay as they are, so the result is for people and cannot be read back.

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
    """The same inside HTML: no tag, no entity."""
    return html.escape(printable(text))
