"""The command line that the scripts of this folder share. Importing it writes nothing and imports nothing large."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ROOT / "docs" / "pictures"


def command(file: str, doc: str | None) -> argparse.ArgumentParser:
    """Make the parser of a script, from its file and its docstring; `--help` prints the whole docstring."""
    path = Path(file).resolve()
    path = path.parent if path.stem == "__main__" else path.with_suffix("")
    return argparse.ArgumentParser(
        prog="python -m " + ".".join(path.relative_to(ROOT).parts),
        description=doc,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )


def at_least_one(text: str) -> int:
    """A number of things to measure: at least one."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} is too few; at least 1")
    return number


def arm_name(text: str) -> str:
    """The name of a bundled arm: a wrong one is refused before hours are spent on the others."""
    from kinseek.robots import catalog_names

    if text not in catalog_names():
        raise argparse.ArgumentTypeError(f"no arm {text!r}; there are {', '.join(catalog_names())}")
    return text


def writes(parser: argparse.ArgumentParser, option: str, default: Path, what: str) -> None:
    """Add the option that says where output goes; without it, a file that the repository keeps is written anew."""
    shown = default.relative_to(ROOT)
    parser.add_argument(option, type=Path, default=default, help=f"{what}; {shown} if it is left out")


def under_pytest(file: str, doc: str | None) -> None:
    """Run a file of benchmarks that are written as tests, as ``pytest FILE --benchmark-only`` does."""
    parser = command(file, doc)
    parser.add_argument("-k", metavar="EXPRESSION", help="only those whose names match, as pytest's -k")
    chosen = parser.parse_args().k
    import pytest

    sys.exit(pytest.main([file, "--benchmark-only", *(["-k", chosen] if chosen else [])]))
