"""Files, mutated at random: whatever is in one, reading it ends soon, in what was meant or in a KinseekError.

    python -m tests.fuzz.files --count 20000 --seed 0 [--corpus FOLDER]

Descriptions of robots (URDF, xacro with and without trust, MJCF), DH tables, obstacles, SRDF, tables of poses, lines of
poses, goals. They start from the bundled arms, from tests/fuzz/corpus and from a folder of one's own. Case i of a seed is
always the same file. Each is read in another process, so that a crash or a hang of the libraries that read for us is a
finding like any other: an exception that is no KinseekError, more than ten seconds of processor time, a chain with NaN or
with crossed limits, a word on stdout or stderr. `--show I` prints case I.
"""

from __future__ import annotations

import argparse
import math
import os
import resource
import select
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path
from random import Random
from typing import NamedTuple

from kinseek.robots import catalog_names, catalog_path

from .mutations import OF_OTHERS, OF_XML
from .readers import CORPUS, READERS, judge, kind_of

MOST_SECONDS = 10.0
"""Processor time that one file may take [s]."""
START = 30.0
"""Processor time that a worker may take to start, on top [s]."""
PATIENCE = 60.0
"""When a worker that neither answers nor computes is given up [s]: it waits for something that does not come."""
MOST_BYTES = 4_000_000
"""No file gets longer: a long one that is written hundreds of times is memory that only its making takes."""
MEMORY = 8 * 2**30
"""What a worker may allocate, in bytes."""

BESIDE = ("more.xacro", "more.xml")
"""Files of the corpus that others include; they are mutated, too."""

SHARES = dict.fromkeys(READERS, 1) | {".urdf": 6, ".xacro": 6, ".xml": 4, ".obstacles.urdf": 2}
SHARES |= {".scene": 2, ".dh.json": 2, ".csv": 2, ".goal.json": 2}
"""How often each kind of file is taken."""

Seeds = Mapping[str, list[bytes]]
"""Files to start from, by the kind that chooses their reader."""


class Case(NamedTuple):
    """One file to read."""

    name: str
    text: bytes
    beside: dict[str, bytes]
    """Files in the same folder."""


def seeds(corpus: Path | None = None) -> Seeds:
    """What is mutated: every bundled arm, the corpus, and the files of a folder."""
    found: dict[str, list[bytes]] = {kind: [] for kind in SHARES}
    for folder in (CORPUS, *([corpus] if corpus else [])):
        for path in sorted(folder.rglob("*")):
            if kind_of(path) in READERS and path.name not in BESIDE:
                found[kind_of(path)].append(path.read_bytes())
    found[".urdf"] += [catalog_path(name).read_bytes() for name in catalog_names()]
    return found


def case(number: int, seed: int, from_: Seeds) -> Case:
    """The file of this number: always the same."""
    random = Random(f"{seed}:{number}")
    kind = random.choices(list(SHARES), list(SHARES.values()))[0]
    text = random.choice(from_[kind])
    mutations = OF_XML if text.lstrip().startswith(b"<") else OF_OTHERS
    for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
        mutated = random.choice(mutations)(random, text)
        text = mutated if len(mutated) <= MOST_BYTES else text
    beside = {name: (CORPUS / name).read_bytes() for name in BESIDE}
    if random.random() < 0.2:
        name = random.choice(list(beside))
        beside[name] = random.choice(OF_XML)(random, beside[name])
    ending = kind if random.random() < 0.95 else random.choice((*READERS, ".URDF"))
    return Case(random.choice(("case", "untrusted")) + ending, text, beside)


def write(folder: Path, what: Case) -> Path:
    """Write a case and the files beside it."""
    for name, text in {**what.beside, what.name: what.text}.items():
        (folder / name).write_bytes(text)
    return folder / what.name


def work(seed: int, corpus: Path | None) -> None:
    """Read cases by their numbers from stdin, and answer each in one line."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    answers = os.fdopen(os.dup(1), "w")
    from_ = seeds(corpus)
    with tempfile.TemporaryDirectory() as name, tempfile.TemporaryFile() as said:
        folder = Path(name)
        os.chdir(folder)
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
        for line in sys.stdin:
            for old in folder.iterdir():
                old.unlink()
            what = case(int(line), seed, from_)
            path = write(folder, what)
            begin = time.process_time()
            result = judge(path)
            seconds = time.process_time() - begin
            sys.stdout.flush()
            said.seek(0)
            if noise := said.read():
                said.seek(0)
                said.truncate()
                result = f"SAID {noise[:500]!r} and {result}"
            elif seconds > MOST_SECONDS:
                result = f"SLOW {seconds:.1f} s and {result}"
            elif left := {p.name for p in folder.iterdir()} - {what.name, *what.beside}:
                result = f"LEFT {left} and {result}"
            print(f"{seconds:.3f} {result!r}", file=answers, flush=True)


def _processor_seconds(process: int) -> float:
    """Processor time that a process has used [s]; wall time where the system does not tell."""
    try:
        words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return time.monotonic()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


class Worker:
    """A process that reads files; when it dies, the next takes its place."""

    def __init__(self, seed: int, corpus: Path | None) -> None:
        """Start no process yet."""
        self.words = [sys.executable, "-m", "tests.fuzz.files", "--worker", "--seed", str(seed)]
        self.words += ["--corpus", str(corpus.resolve())] if corpus else []
        self.process: subprocess.Popen[str] | None = None

    def ask(self, number: int) -> tuple[float, str]:
        """Let it read one case: processor seconds, and how it ended."""
        if self.process is None:
            self.process = subprocess.Popen(
                self.words,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                text=True,
                cwd=Path(__file__).parents[2],
            )
        process = self.process
        assert process.stdin is not None
        assert process.stdout is not None
        process.stdin.write(f"{number}\n")
        process.stdin.flush()
        begin, moved = _processor_seconds(process.pid), time.monotonic()
        last = begin
        while not select.select([process.stdout], [], [], 2.0)[0]:
            now = _processor_seconds(process.pid)
            if now > last:  # On a busy machine it may get little of the processor, but some.
                last, moved = now, time.monotonic()
            if now - begin > MOST_SECONDS + START or time.monotonic() - moved > PATIENCE:
                self.close()
                return now - begin, "HUNG"
        line = process.stdout.readline()
        if not line:
            code = process.wait()
            self.close()
            return math.nan, f"CRASHED with {code}"
        seconds, _, result = line.partition(" ")
        return float(seconds), str(eval(result))  # Our own repr.

    def close(self) -> None:
        """End it."""
        if self.process is not None:
            self.process.kill()
            self.process.communicate()
            self.process = None


def findings(first: int, count: int, seed: int, corpus: Path | None) -> Iterator[tuple[int, float, str]]:
    """Of each case: its number, processor seconds, and how reading it ended."""
    worker = Worker(seed, corpus)
    try:
        for number in range(first, first + count):
            yield (number, *worker.ask(number))
    finally:
        worker.close()


def main() -> int:
    """Run the command that stands at the head of this file."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--corpus", type=Path)
    parser.add_argument("--show", type=int)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    chosen = parser.parse_args()
    if chosen.worker:
        work(chosen.seed, chosen.corpus)
        return 0
    if chosen.show is not None:
        what = case(chosen.show, chosen.seed, seeds(chosen.corpus))
        print(what.name, what.beside, file=sys.stderr)
        sys.stdout.buffer.write(what.text)
        return 0
    counts: Counter[str] = Counter()
    slowest = (0.0, -1)
    for number, seconds, result in findings(chosen.first, chosen.count, chosen.seed, chosen.corpus):
        counts[result.split()[0]] += 1
        slowest = max(slowest, (seconds, number))
        if result not in ("loaded", "refused"):
            print(f"case {number}: {result}", flush=True)
        if (number + 1) % 1000 == 0:
            print(f"{number + 1}: {dict(counts)}, slowest {slowest[0]:.1f} s (case {slowest[1]})", flush=True)
    print(f"{sum(counts.values())} files: {dict(counts)}, slowest {slowest[0]:.1f} s (case {slowest[1]})")
    return int(any(name not in ("loaded", "refused") for name in counts))


if __name__ == "__main__":
    sys.exit(main())
