"""The command line, with one file per command in `commands`. It has no computations of its own.

Exit codes: 0 done or reached, 1 not reached or found unsound, 2 misuse or output that cannot be written, 130 stopped with
Ctrl-C, 141 the reader of a pipe is gone.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence

from kinseek.errors import MissingExtra


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    Args:
        arguments: The words after the program's name; by default those of the process.
    """
    try:
        from .program import run
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] != "click":
            raise
        print(f"kinseek: {MissingExtra('the command line', 'cli')}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:  # During the import.
        sys.exit(130)
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))
