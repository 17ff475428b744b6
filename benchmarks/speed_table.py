"""The speed table of the README, made from field.md where that is kept, else from peers.md.

python -m benchmarks.speed_table           # after python -m benchmarks.field --half --keep, or python -m benchmarks.peers
"""

from __future__ import annotations

from .command import ROOT, command, writes

README = ROOT / "README.md"
PAGES = ROOT / "benchmarks" / "field.md", ROOT / "benchmarks" / "peers.md"
SOURCE = next((page for page in PAGES if page.is_file()), PAGES[-1])
BEGIN, END = "<!-- speed table: python -m benchmarks.speed_table -->\n", "<!-- end -->\n"


def table(page: str) -> str:
    """Medians [µs] of every arm and library with their ratio to the first, and the share of near-singular targets solved."""
    medians: dict[str, dict[str, str]] = {}
    shares: dict[str, list[float]] = {}
    for row in page.splitlines():
        cells = [cell.strip(" *") for cell in row.strip("|").split("|")]
        if len(cells) != 8 or cells[0] in ("arm", "---"):
            continue
        medians.setdefault(cells[0], {})[cells[1]] = cells[2]
        if cells[6] != "–":
            shares.setdefault(cells[1], []).append(float(cells[6]))
    arms, who = list(medians), list(shares)
    lines = [
        "| solver | " + " | ".join(arms) + " | near singular |",
        "|---|" + "--:|" * (len(arms) + 1),
    ]
    for name in who:
        found = [_with_ratio(medians[arm][name], medians[arm][who[0]]) for arm in arms]
        lines.append(
            f"| {name} | " + " | ".join(found) + f" | {min(shares[name]):.1f} – {max(shares[name]):.1f} % |"
        )
    return "\n".join(lines) + "\n"


def _with_ratio(median: str, first: str) -> str:
    """A median and how many times the first one it is."""
    if median in ("–", first):
        return _short(median)
    ratio = float(median) / float(first)
    return f"{_short(median)} ({ratio:,.1f})" if ratio < 10.0 else f"{_short(median)} ({ratio:,.0f})"


def _short(number: str) -> str:
    """A number without a decimal place that nobody reads."""
    return f"{float(number):,.0f}" if number != "–" and float(number) >= 100.0 else number


def updated(readme: str, page: str) -> str:
    """The README with its table made anew."""
    before, rest = readme.split(BEGIN)
    return before + BEGIN + table(page) + END + rest.split(END, 1)[1]


def main() -> None:
    """Write the README with its table made anew."""
    parser = command(__file__, __doc__)
    writes(parser, "--output", README, "where the README with its new table goes")
    output = parser.parse_args().output
    text = updated(README.read_text(encoding="utf-8"), SOURCE.read_text(encoding="utf-8"))
    output.write_text(text, encoding="utf-8")
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
