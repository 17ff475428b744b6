"""The table of speed in the README, made from speed.md.

python -m benchmarks.speed_table           # after python -m benchmarks.field --table --keep
"""

from __future__ import annotations

from .command import ROOT, command, writes
from .field.page import SPEED

README = ROOT / "README.md"
BEGIN, END = "<!-- speed table: python -m benchmarks.speed_table -->\n", "<!-- end -->\n"


def table(page: str) -> str:
    """Medians [µs] of every arm and solver with their ratio to kinseek, and the share of near-singular targets solved."""
    cells: dict[str, dict[str, str]] = {}
    shares: dict[str, list[float]] = {}
    reasons: dict[str, str] = {}
    arms: list[str] = []
    for row in page.splitlines():
        columns = [column.strip() for column in row.split("|")[1:-1]]
        if len(columns) != 10 or columns[0] in ("arm", "---"):
            continue
        arm, solver, median, ratio = columns[:4]
        arms += [arm] * (arm not in arms)
        cells.setdefault(solver, {})[arm] = _cell(median, ratio.split(" ")[0])
        shares.setdefault(solver, []).extend(float(share) for share in columns[7:8] if share != "–")
        reasons[solver] = columns[9]
    lines = ["| solver | " + " | ".join(arms) + " | near singular |", "|---|" + "--:|" * (len(arms) + 1)]
    for solver, by in cells.items():
        found = shares[solver]
        near = f"{min(found):.1f} – {max(found):.1f} %" if found else reasons[solver] or "–"
        lines.append(f"| {solver} | " + " | ".join(by.get(arm, "–") for arm in arms) + f" | {near} |")
    return "\n".join(lines) + "\n"


def _cell(median: str, ratio: str) -> str:
    """A median and how many times that of kinseek it is, without decimal places that nobody reads."""
    short = _short(median, 100.0)
    return (
        short if median == "–" or float(ratio.replace(",", "")) == 1.0 else f"{short} ({_short(ratio, 10.0)})"
    )


def _short(number: str, whole: float) -> str:
    if number == "–":
        return number
    value = float(number.replace(",", ""))
    return f"{value:,.0f}" if value >= whole else f"{value:.1f}"


def updated(readme: str, page: str) -> str:
    """The README with a new table."""
    before, rest = readme.split(BEGIN)
    return before + BEGIN + table(page) + END + rest.split(END, 1)[1]


def main() -> None:
    """Write the README with a new table."""
    parser = command(__file__, __doc__)
    writes(parser, "--output", README, "where the README with its new table goes")
    output = parser.parse_args().output
    text = updated(README.read_text(encoding="utf-8"), SPEED.read_text(encoding="utf-8"))
    output.write_text(text, encoding="utf-8")
    print(f"wrote {output}")


if __name__ == "__main__":
    main()
