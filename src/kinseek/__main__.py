"""Run the command line with ``python -m kinseek``."""

from .cli import main

main()
