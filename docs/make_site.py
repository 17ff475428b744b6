"""Makes the site: gathers the pages of the repository into build/pages, and has Zensical make build/site of them.

Run: python docs/make_site.py

The pages are written to be read in the repository: README.md is the first page, those of docs/ stand at the top, those of
benchmarks/ and experiments/ and the examples in folders of these names. Links between them are rewritten here; a link to
any other file takes the file along. Zensical (extra `docs`) refuses a link, an anchor or a line of the navigation that leads
nowhere. What is made needs no server and no network. Where `python web/build.py` has made the page in which an arm can be
dragged, the first page leads to it.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

ROOT = Path(__file__).resolve().parents[1]
PAGES = ROOT / "build" / "pages"
SITE = ROOT / "build" / "site"
TRY = ROOT / "web" / "dist" / "index.html"
"""The page without a server."""

LINK = re.compile(r"(?<=\]\()[^()\s]+(?=\))|(?<=\bsrc=\")[^\"]+(?=\")|(?<=\bhref=\")[^\"]+(?=\")")
"""Where a link of Markdown, or a picture or link in HTML, leads."""
CODE = re.compile(r"^ *(`{3,}).*?^ *\1 *$|(?<!`)(`+)(?!`).+?(?<!`)\2(?!`)", re.MULTILINE | re.DOTALL)
ELSEWHERE = re.compile(r"[a-z]+:|//|#")


def sources() -> list[Path]:
    """Every page, as it lies in the repository."""
    found = [
        ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md", "experiments/README.md")
    ]
    for pattern in ("docs/**/*.md", "benchmarks/**/*.md", "examples/[0-9]*.py"):
        found += sorted(ROOT.glob(pattern))
    return found


def place(source: Path) -> PurePosixPath:
    """Where a file of the repository stands on the site."""
    path = PurePosixPath(source.relative_to(ROOT).as_posix())
    if path.name == "README.md":
        return path.with_name("index.md")
    if path.parts[0] == "docs":
        return path.relative_to("docs")
    if path.parts[0] == "examples" and path.suffix == ".py":
        return path.with_suffix(".md")
    return path


def links(text: str, rewrite: Callable[[str], str]) -> str:
    """Replace where each link of a page leads; what only looks like a link, in code, is left as it is."""
    pieces, end = [], 0
    for code in CODE.finditer(text):
        pieces += [LINK.sub(lambda link: rewrite(link[0]), text[end : code.start()]), code[0]]
        end = code.end()
    return "".join([*pieces, LINK.sub(lambda link: rewrite(link[0]), text[end:])])


def example(source: Path) -> str:
    """The page of an example: its docstring, its picture and its code."""
    _, docstring, code = source.read_text(encoding="utf-8").split('"""', 2)
    title = docstring.split(":")[0]
    picture = ROOT / "docs" / "pictures" / f"{source.stem}.png"
    picture_line = (
        f"![What the example draws.](../docs/pictures/{picture.name})\n\n" if picture.exists() else ""
    )
    docstring = re.sub(r"^Run: (.*)$", r"Run: `\1`", docstring.strip(), flags=re.MULTILINE)
    return f"# {title}\n\n{docstring}\n\n{picture_line}```python\n{code.strip()}\n```\n"


def gather(to: Path = PAGES) -> None:
    """Write every page, and what pages link to, as the site has them."""
    shutil.rmtree(to, ignore_errors=True)
    for source in sources():
        page = to / place(source)
        page.parent.mkdir(parents=True, exist_ok=True)

        def rewrite(link: str, source: Path = source, page: Path = page) -> str:
            name, mark, anchor = link.partition("#")
            if ELSEWHERE.match(link):
                return link
            target = Path(os.path.normpath(source.parent / unquote(name)))
            there = to / place(target)
            if target.is_file() and there.suffix != ".md" and not there.exists():
                there.parent.mkdir(parents=True, exist_ok=True)
                shutil.copyfile(target, there)
            return Path(os.path.relpath(there, page.parent)).as_posix() + mark + anchor

        text = example(source) if source.suffix == ".py" else source.read_text(encoding="utf-8")
        if source.name == "README.md" and source.parent == ROOT and TRY.exists():
            shutil.copyfile(TRY, to / "try.html")
            text = text.replace(
                "\n## Two commands\n",
                "\n[Drag an arm, here in the browser](try.html)\n\n## Two commands\n",
                1,
            )
        page.write_text(links(text, rewrite), encoding="utf-8")
    shutil.copytree(ROOT / "docs" / "assets", to / "assets")


def use_local_worker() -> None:
    """Let the search load its worker from the site: Zensical would load it from another server."""
    for page in SITE.rglob("*.html"):
        ours = os.path.relpath(SITE / "assets" / "worker.js", page.parent)
        text = page.read_text(encoding="utf-8")
        page.write_text(text.replace("https://unpkg.com/iframe-worker/shim", ours), encoding="utf-8")


def main() -> int:
    """Make the site; the exit code is 0 only if nothing on it leads nowhere."""
    gather()
    made = subprocess.run(
        [
            sys.executable,
            "-m",
            "zensical",
            "build",
            "--strict",
            "--clean",
            "--config-file",
            str(ROOT / "mkdocs.yml"),
        ],
        cwd=ROOT,
        check=False,
    )
    if made.returncode == 0:
        use_local_worker()
        print(SITE / "index.html")
    return made.returncode


if __name__ == "__main__":
    sys.exit(main())
