"""The command line that the scripts of this folder share. Importing it writes nothing and imports nothing large."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HERE = ROOT / "benchmarks"
PICTURES = ROOT / "docs" / "pictures"

QUICK_ARMS = 2
"""Arms of a quick run: the first of those that are measured by default."""


class Command(argparse.ArgumentParser):
    """The parser of a script, with what many of them ask."""

    def __init__(self, file: str, doc: str | None) -> None:
        """Take the name from the file; `--help` prints the whole docstring."""
        path = Path(file).resolve()
        path = path.parent if path.stem == "__main__" else path.with_suffix("")
        super().__init__(
            prog="python -m " + ".".join(path.relative_to(ROOT).parts),
            description=doc,
            formatter_class=argparse.RawDescriptionHelpFormatter,
            allow_abbrev=False,
        )
        self._counts: dict[str, tuple[int, int]] = {}
        self._arms: Sequence[str] | None = None

    def options(self) -> argparse.Namespace:
        """Read the command line; what is not given is the full size, or with `--quick` the small one."""
        options = self.parse_args()
        options.quick = getattr(options, "quick", False)
        for name, sizes in self._counts.items():
            if getattr(options, name) is None:
                setattr(options, name, sizes[options.quick])
        if self._arms is not None and not options.arms:
            options.arms = tuple(self._arms or _bundled())[: QUICK_ARMS if options.quick else None]
        return options

    def ask(self, arms: Sequence[str] | None, page: str, counts: dict[str, tuple[int, int, str]]) -> None:
        """Add the options that `command` describes."""
        if arms is not None:
            default = ", ".join(arms) or "all bundled arms"
            self.add_argument("arms", nargs="*", type=arm_name, help=f"names or files; {default} if left out")
            self._arms = arms
        for name, (full, quick, what) in counts.items():
            self.add_argument(f"--{name}", type=at_least_one, help=f"{what}; {full:,} if left out")
            self._counts[name] = full, quick
        if page:
            self.add_argument("--quick", action="store_true", help="small numbers; printed and not written")
        if page:
            writes(self, "--output", HERE / page, "page to write")


def command(
    file: str,
    doc: str | None,
    *,
    arms: Sequence[str] | None = None,
    page: str = "",
    **counts: tuple[int, int, str],
) -> Command:
    """Make the parser of a script.

    Args:
        file: Of the script.
        doc: Its docstring.
        arms: Arms that are measured by default, all bundled ones if empty; None if a script takes no arms.
        page: Name of the page in this folder that is written; with one, a script can be `--quick` and writes none.
        counts: Numbers of things to measure, with `--quick` the second one, and what they are.
    """
    parser = Command(file, doc)
    parser.ask(arms, page, counts)
    return parser


def at_least_one(text: str) -> int:
    """A number of things to measure: at least one."""
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{number} is too few; at least 1")
    return number


def arm_name(text: str) -> str:
    """The name of a bundled arm, or a file: a wrong one is refused before hours are spent on the others."""
    if text not in _bundled() and not Path(text).is_file():
        raise argparse.ArgumentTypeError(f"no arm {text!r}; there are {', '.join(_bundled())}")
    return text


def _bundled() -> tuple[str, ...]:
    from kinseek.robots import catalog_names

    return catalog_names()


def writes(parser: argparse.ArgumentParser, option: str, default: Path, what: str) -> None:
    """Add the option that says where output goes; without it, a file that the repository keeps is written anew."""
    shown = default.relative_to(ROOT)
    parser.add_argument(option, type=Path, default=default, help=f"{what}; {shown} if it is left out")
