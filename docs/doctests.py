"""Tells Griffe, which reads the docstrings for the site's reference, that lines with ``>>>`` are code."""

from __future__ import annotations

import re
from typing import Any

import griffe


class Doctests(griffe.Extension):
    """Indents them, as Markdown wants code, and drops what only doctest reads."""

    def on_object(self, *, obj: griffe.Object, **kwargs: Any) -> None:
        """Change the docstring of anything that has one."""
        if obj.docstring:
            lines = re.sub(r" *# doctest:.*$", "", obj.docstring.value, flags=re.MULTILINE)
            obj.docstring.value = re.sub(r"^(>>> )", r"    \1", lines, flags=re.MULTILINE)
