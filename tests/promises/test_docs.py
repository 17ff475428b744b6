"""What the documentation shows runs, and where it points to is there.

Every Python block of a page runs, one after the other with the same names. A comment before a block, which no reader sees,
says what is special about it:

    <!-- needs: ikpy, eaik -->          runs where these can be imported, after the plain blocks before it
    <!-- not run: what is in the way --> does not run
    <!-- ends with: 1 -->                the exit code of its commands, where it is not 0
    <!-- printed: above -->              what the Python block before this block of text prints; … stands for anything
    <!-- file: poses.csv -->             lies there as a file when Python and commands of the page run

A line of a shell block that begins with ``kinseek`` runs too, unless its block is marked so. What serves until it is stopped
is left out.
"""

from __future__ import annotations

import ast
import contextlib
import importlib.util
import io
import os
import re
import shlex
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from places import ROOT

if not (ROOT / "docs").is_dir():
    pytest.skip("the documentation is not part of what is tested here", allow_module_level=True)
sys.path.insert(0, str(ROOT / "docs"))

import make_site  # A script of the documentation.

import kinseek
import kinseek.errors

LANGUAGES = {"python", "sh", "text", "c", "xml", "csv", "json", "yaml", "cmake", "html", "js"}
BLOCK = re.compile(
    r"(?:^<!-- (?P<mark>needs|not run|ends with|printed|file): (?P<words>[^>]+) -->\n+)?"
    r"^```(?P<language>\S*)[^\n]*\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)


@dataclass(frozen=True)
class Block:
    page: Path
    line: int
    language: str
    code: str
    needs: tuple[str, ...] = ()
    not_run: str = ""
    code_at_end: int = 0
    prints: str | None = None
    file: str = ""

    def __str__(self) -> str:
        return f"{self.page.relative_to(ROOT)}:{self.line}"

    def run(self, names: dict[str, object]) -> None:
        lines = "\n" * self.line  # So that an error names the line of the page.
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(lines + self.code, str(self.page), "exec"), names)
        if self.prints is not None:
            pattern = ".*?".join(re.escape(part) for part in " ".join(self.prints.split()).split("…"))
            assert re.fullmatch(pattern, " ".join(out.getvalue().split())), out.getvalue()


def blocks_of(page: Path) -> list[Block]:
    text = page.read_text(encoding="utf-8")
    found: list[Block] = []
    for match in BLOCK.finditer(text):
        words = (match["words"] or "").strip()
        if match["mark"] == "printed":
            found[-1] = replace(found[-1], prints=match["code"])
        found.append(
            Block(
                page,
                text[: match.start("language")].count("\n") + 1,
                match["language"],
                match["code"],
                tuple(words.split(", ")) if match["mark"] == "needs" else (),
                words if match["mark"] == "not run" else "",
                int(words) if match["mark"] == "ends with" else 0,
                file=words if match["mark"] == "file" else "",
            )
        )
    return found


PAGES = [page for page in make_site.sources() if page.suffix == ".md"]
BLOCKS = [block for page in PAGES for block in blocks_of(page)]
PYTHON = [block for block in BLOCKS if block.language == "python" and not block.not_run]
COMMANDS = [
    (block, line)
    for block in BLOCKS
    if block.language == "sh" and not block.not_run
    for line in block.code.replace("\\\n", " ").splitlines()
    if line.startswith("kinseek ") and not line.startswith("kinseek view ")
]


@pytest.fixture
def beside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[Path], None]:
    """Go to an empty folder, where only the files of a page lie."""

    def go(page: Path) -> None:
        monkeypatch.chdir(tmp_path)
        for block in blocks_of(page):
            if block.file:
                Path(block.file).write_text(block.code, encoding="utf-8")

    return go


def name_of(page: Path) -> str:
    return page.relative_to(ROOT).as_posix()


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted({block.page for block in PYTHON}), ids=name_of)
def test_python_runs(page: Path, beside: Callable[[Path], None]) -> None:
    beside(page)
    names: dict[str, object] = {"__name__": "__main__"}
    for block in PYTHON:
        if block.page == page and not block.needs:
            block.run(names)


@pytest.mark.slow
@pytest.mark.parametrize("block", [block for block in PYTHON if block.needs], ids=str)
def test_python_that_needs_more_runs(block: Block, beside: Callable[[Path], None]) -> None:
    lacking = [name for name in block.needs if importlib.util.find_spec(name) is None]
    if lacking:
        pytest.skip(f"not installed: {', '.join(lacking)}")
    beside(block.page)
    names: dict[str, object] = {"__name__": "__main__"}
    for before in PYTHON:
        if before.page == block.page and before.line < block.line and not before.needs:
            before.run(names)
    block.run(names)


@pytest.mark.slow
@pytest.mark.parametrize(("block", "command"), COMMANDS, ids=[f"{block}: {line}" for block, line in COMMANDS])
def test_command_runs(block: Block, command: str, beside: Callable[[Path], None]) -> None:
    from kinseek.cli import main

    beside(block.page)
    if "--scene" in command:
        pytest.importorskip("pinocchio")
    words = shlex.split(command, comments=True)
    if {"|", "<", ">", "&&"} & set(words):
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        ended = subprocess.run(["bash", "-c", command], env={**os.environ, "PATH": path}, check=False)
        assert ended.returncode == block.code_at_end
        return
    with pytest.raises(SystemExit) as left:
        main(words[1:])
    assert (left.value.code or 0) == block.code_at_end


def test_every_public_name_is_in_the_reference() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "api").glob("*.md"))
    named = re.findall(r"^::: kinseek\.(\w+)$", text, re.MULTILINE)
    assert sorted(name for name in kinseek.__all__ if name not in named) == []


def test_every_extra_is_on_the_page_of_installing() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    text = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    assert [name for name in project["optional-dependencies"] if f"`{name}`" not in text] == []


@pytest.mark.parametrize("said", ["Solved: …", "Solved: both …\nwithin their tolerances."])
def test_what_is_printed_is_compared(said: str) -> None:
    block = Block(
        ROOT / "README.md", 1, "python", "import kinseek\nprint(kinseek.Status.SOLVED)", prints=said
    )
    block.run({})
    with pytest.raises(AssertionError):
        replace(block, prints=said.replace("Solved", "Solve")).run({})


def test_every_error_has_its_cure() -> None:
    """The page has a heading for each public error, in the order of errors.py, and an example that raises it."""
    page = ROOT / "docs" / "errors.md"
    names = [
        name
        for name, value in vars(kinseek.errors).items()
        if isinstance(value, type) and issubclass(value, Exception) and value.__module__ == "kinseek.errors"
    ]
    assert {name for name in dir(kinseek) if name in names} == set(names)
    text = page.read_text(encoding="utf-8")
    assert re.findall(r"^## `(\w+)`$", text, re.MULTILINE) == [
        name for name in names if name != "KinseekError"
    ]
    for name in names:
        assert f"kinseek.{name}" in "".join(block.code for block in blocks_of(page)), name


def test_every_block_says_what_it_is_in() -> None:
    """A block of Python by another name would not be run."""
    assert [f"{block}: {block.language!r}" for block in BLOCKS if block.language not in LANGUAGES] == []
    assert len(PYTHON) > 20
    assert len(COMMANDS) > 0


def test_python_that_is_not_run_is_valid() -> None:
    for block in BLOCKS:
        if block.language == "python":
            ast.parse(block.code, str(block))


def anchors(page: Path) -> set[str]:
    """The anchors of a page's headings, as the repository's pages and the site have them."""
    text = make_site.CODE.sub(
        lambda code: "" if code[0].lstrip().startswith("```") else code[0].strip("`"),
        page.read_text(encoding="utf-8"),
    )
    seen: dict[str, int] = {}
    found = set()
    for heading in re.findall(r"^#+ +(.*?) *$", text, re.MULTILINE):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("*", "")
        slug = re.sub(r"[^\w\- ]", "", plain.lower()).replace(" ", "-")
        found.add(slug + (f"-{seen[slug]}" if slug in seen else ""))
        seen[slug] = seen.get(slug, 0) + 1
    return found


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page: Path) -> None:
    broken = []

    def follow(link: str) -> str:
        name, _, anchor = link.partition("#")
        if not re.match(r"[a-z]+:", link):
            target = (page.parent / name).resolve() if name else page
            if not target.exists() or (anchor and anchor not in anchors(target)):
                broken.append(link)
        return link

    make_site.links(page.read_text(encoding="utf-8"), follow)
    assert broken == []


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_files_that_are_named_are_there(page: Path) -> None:
    """Tests, benchmarks and examples in backticks; modules that are run with ``-m`` too."""
    text = page.read_text(encoding="utf-8")
    named = re.findall(r"`[^`\n]*?\b((?:tests|benchmarks|examples)/[\w./]+\.py)", text)
    named += [
        f"{one.replace('.', '/')}" for one in re.findall(r"python -m ((?:tests|benchmarks)[\w.]*)", text)
    ]
    for name in set(named) - {"examples/NN_name.py"}:  # Which stands for any.
        place = ROOT / name.rstrip("/.")
        assert place.is_file() or place.with_suffix(".py").is_file() or (place / "__main__.py").is_file(), (
            name
        )


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_rows_of_a_table_have_as_many_cells_as_its_head(page: Path) -> None:
    """A bar inside a cell begins another cell, and the page then shows the row broken."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
    broken = []
    for table in re.findall(r"^(?:\|.*\n?)+", text, re.MULTILINE):
        rows = [re.sub(r"`[^`]*`|\\\|", "", row) for row in table.splitlines()]
        broken += [row[:100] for row in rows if row.count("|") != rows[0].count("|")]
    assert broken == []


def test_a_broken_link_is_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        '# A `b` & c\n\n[x](y.md) `[no](no.md)` ![](p.png) <img src="q.png">\n\n```\n[no](no)\n# no\n```\n'
    )
    seen: list[str] = []

    def rewrite(link: str) -> str:
        seen.append(link)
        return "z"

    text = make_site.links(page.read_text(), rewrite)
    assert seen == ["y.md", "p.png", "q.png"]
    assert text.count("(z)") == 2
    assert anchors(page) == {"a-b--c"}


def test_every_page_has_its_place_in_the_navigation() -> None:
    navigation = (ROOT / "mkdocs.yml").read_text(encoding="utf-8").split("\nnav:\n")[1]
    named = re.findall(r"^ +- (?!#)[^:#]+: (\S+\.md)$", navigation, re.MULTILINE)
    assert sorted(named) == sorted(str(make_site.place(page)) for page in make_site.sources())


@pytest.fixture(scope="module")
def site() -> Path:
    """The site, made anew: a warning is an error."""
    pytest.importorskip("zensical")
    assert make_site.main() == 0
    return make_site.SITE


@pytest.mark.slow
@pytest.mark.thorough
def test_the_site_asks_nothing_of_the_network(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) > len(PAGES)
    fetched = re.compile(
        r"<(?:script|img|iframe|source|video)[^>]*\bsrc=\"?https?:|<link[^>]*rel=\"?stylesheet[^>]*https?:"
    )
    assert [page.name for page in pages if fetched.search(page.read_text(encoding="utf-8"))] == []


@pytest.mark.slow
@pytest.mark.thorough
def test_the_site_is_searched_from_a_folder(site: Path) -> None:
    """In a browser, where nothing may be asked for but files."""
    api = pytest.importorskip("playwright.sync_api")
    chromium = shutil.which("chromium") or pytest.skip("no chromium")
    asked: list[str] = []
    with api.sync_playwright() as play:
        browser = play.chromium.launch(executable_path=chromium, args=["--no-sandbox"])
        page = browser.new_page()
        page.on("request", lambda request: asked.append(request.url))
        page.on("pageerror", lambda error: asked.append(f"error: {error}"))
        page.goto((site / "index.html").as_uri())
        page.get_by_role("button", name="Search").first.click()
        page.get_by_role("textbox").or_(page.get_by_role("combobox")).first.fill("manipulability")
        page.get_by_text("product of the Jacobian").first.wait_for(timeout=30_000)
        browser.close()
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:", "about:"))] == []
