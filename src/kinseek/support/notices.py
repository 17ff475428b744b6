"""Lines on stderr for the person who waits, without effect on the program: stderr may be closed, full or a broken pipe."""

from __future__ import annotations

import sys
from contextlib import suppress

from kinseek.printable import printable


def notice(line: str) -> None:
    """Print one line on stderr, with escapes, if there is a stderr that accepts it."""
    # `print` would write to stdout, among the results, if sys.stderr is None. A closed file raises a ValueError.
    if sys.stderr is not None:
        with suppress(OSError, ValueError):
            print(f"kinseek: {printable(line)}", file=sys.stderr, flush=True)
