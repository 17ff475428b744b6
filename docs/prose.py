"""Check the English of the pages and docstrings: proselint's checks, and rules for words that made readers stop.

Run: python docs/prose.py [FILE ...]

Without files it reads README.md, CONTRIBUTING.md, the pages of docs/ and the docstrings below src/. Code is skipped.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

from proselint.checks import __register__ as usual
from proselint.config import DEFAULT
from proselint.registry import CheckRegistry
from proselint.registry.checks import Check, CheckFlags, types
from proselint.tools import LintFile

ROOT = Path(__file__).resolve().parents[1]

RULES = {
    r"\b(?:[Tt]old|[Tt]ells?)\b": "say 'report', 'return', 'describe', 'is reported' or 'is given'",
    r"\b[Ll]ack(?:s|ed|ing)?\b": "say 'miss', 'is missing' or 'without'",
    r"\b(?:what|is|are|was|were) asked\b": "say 'is requested'",
    r"\b[Hh]and(?:s|ed|ing)? (?:over|back|out)\b": "say 'pass' or 'return'",
    r"\bas good as\b": "say 'almost'",
    r"\bby turns\b": "say 'interleaved' or 'alternately'",
    r"\bso (?:long|much) takes\b": "put the subject first",
    r"\b[Uu]nlike what\b": "name the thing",
    r"\bslow(?:er)? that day\b": "measure interleaved, and leave the sentence out",
    r"(?:[.!?:;|]\s+|\n\s*)(?:Refused|Rejected|Proved|Kept|Shown|Seen|Left out|Skipped|Counted|Measured|Missing|Given|"
    r"Written|Taken|Chosen|Made|Found|Said|Compared|Read|Tried|Lost|Needed) (?:is|are|was|were)\b": "put the subject first",
    r"(?:[.!?:;|]\s+|\n\s*)(?:Not|Nor) [a-z]+ed (?:is|are|was|were)\b": "put the subject first",
    r"\b(?:is|are) no (?:error|exception|failure|proof|sample|guess|break|matter|goal|answer|solution|name|number)s?\b": (
        "say 'is not'"
    ),
}
"""Patterns, and what to write instead. Each is tried on its sentence in tests/promises/test_prose.py."""

SKIPPED = (
    "typography",
    "misc.phrasal_adjectives",
    "restricted",
    "dates_times",
    "lexical_illusions",
    "weasel_words",
    "annotations",
)
"""Groups of proselint's checks that object to code, units, mathematics and tables."""

EXCUSED = ("revolt", "discriminating", "divide and conquer", "least singular")
"""Terms of the field that proselint takes for something else, as its messages have them."""


def main(names: list[str]) -> int:
    """Print what should be changed, a line each; return 1 if there is something."""
    pages = [Path(name).resolve() for name in names] or sources()
    found = 0
    for path in pages:
        for line, column, message in complaints(path):
            print(f"{path.relative_to(ROOT)}:{line}:{column}: {message}")
            found += 1
    return 1 if found else 0


def sources() -> list[Path]:
    """Every page and module whose English is checked."""
    pages = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]
    return [*pages, *sorted((ROOT / "src").rglob("*.py"))]


def complaints(path: Path) -> Iterator[tuple[int, int, str]]:
    """Line, column and message of each sentence to change."""
    text = path.read_text(encoding="utf-8")
    yield from complaints_in(docstrings(text) if path.suffix == ".py" else prose(text))


def complaints_in(text: str) -> Iterator[tuple[int, int, str]]:
    """Line, column and message of each sentence of a text to change."""
    _register()
    if text.strip():
        config = {"checks": DEFAULT["checks"] | {"kinseek": True}, "max_errors": 10_000}
        for result in LintFile("text", text).lint(config):
            message, place = " ".join(result.check_result.message.split()), result.check_result.span[0]
            before = text[: place - 1]  # proselint puts a line before the text.
            if not any(term in message.lower() for term in EXCUSED):
                column = len(before) - before.rfind("\n")
                yield before.count("\n") + 1, column, f"{message} ({result.check_result.check_path})"


def _register() -> None:
    registry = CheckRegistry()
    if registry.checks:
        return
    registry.register_many(tuple(each for each in usual if not each.path.startswith(SKIPPED)))
    for number, (pattern, advice) in enumerate(RULES.items()):
        registry.register(
            Check(
                check_type=types.ExistenceSimple(pattern=pattern),
                path=f"kinseek.{number}",
                message=f"'{{}}': {advice}",
                flags=CheckFlags(allow_quotes=True),
            )
        )


def prose(page: str) -> str:
    """A page of Markdown, its code, comments and addresses replaced by spaces."""
    for pattern in (
        r"^ *(`{3,}).*?^ *\1 *$",
        r"<!--.*?-->",
        r"`[^`\n]*`",
        r"(?<=\]\()[^()\s]*(?=\))",
        r"<[^<>\n]*>",
    ):
        page = re.sub(pattern, _blank, page, flags=re.MULTILINE | re.DOTALL)
    return page


def docstrings(source: str) -> str:
    """The docstrings of a module, at their lines, without code."""
    lines = [""] * (source.count("\n") + 1)
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            for number, line in enumerate(node.value.value.splitlines(), node.lineno - 1):
                lines[number] = "" if line.lstrip().startswith((">>>", "...")) else line
    return prose("\n".join(lines))


def _blank(found: re.Match[str]) -> str:
    return re.sub(r"\S", " ", found[0])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
