"""``python -m kinseek`` is the command line."""

from .cli import main

main()
