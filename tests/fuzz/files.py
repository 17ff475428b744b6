"""Descriptions of robots, mutated at random: whatever is in a file, reading it ends soon, in an arm or a KinseekError.

    python -m tests.fuzz.files --count 20000 --seed 0 [--corpus FOLDER]

Case i of a seed is always the same file. Each is read in another process, so that a crash or a hang of the libraries
that read for us is a finding like any other: an exception that is no KinseekError, more than ten seconds of processor
time, a chain with NaN or with crossed limits, a word on stdout or stderr. `--show I` prints case I.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import resource
import select
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
from lxml import etree

from kinseek.errors import InvalidRobot, KinseekError
from kinseek.robots import SerialChain, catalog_names, catalog_path, read

MOST_SECONDS = 10.0
"""Processor time that one file may take [s]."""
START = 30.0
"""Processor time that a worker may take to start, on top [s]."""
PATIENCE = 60.0
"""When a worker that neither answers nor computes is given up [s]: it waits for something that does not come."""
MEMORY = 8 * 2**30
"""What a worker may allocate, in bytes."""

XACRO = """<?xml version="1.0"?>
<robot name="mutant" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="reach" default="0.4"/>
  <xacro:property name="length" value="$(arg reach)"/>
  <xacro:property name="turn" value="${pi / 2}"/>
  <xacro:macro name="part" params="n parent axis:='0 0 1' *place">
    <link name="link${n}"/>
    <joint name="joint${n}" type="revolute">
      <xacro:insert_block name="place"/>
      <parent link="${parent}"/><child link="link${n}"/><axis xyz="${axis}"/>
      <limit lower="${-turn}" upper="${radians(170)}" effort="1" velocity="1"/>
    </joint>
  </xacro:macro>
  <link name="base"/>
  <xacro:part n="1" parent="base"><origin xyz="0 0 ${length}"/></xacro:part>
  <xacro:part n="2" parent="link1" axis="0 1 0"><origin xyz="${length} 0 0" rpy="0 ${turn} 0"/></xacro:part>
  <xacro:if value="${length > 0.1}"><xacro:part n="3" parent="link2"><origin xyz="0 0 0.1"/></xacro:part></xacro:if>
  <xacro:include filename="more.xacro"/>
  <link name="tool"/>
  <joint name="end" type="fixed"><parent link="link3"/><child link="tool"/><origin xyz="0 0 ${length / 4}"/></joint>
</robot>
"""
MORE_XACRO = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:property name="unused" value="1"/></robot>
"""
MJCF = """<mujoco model="mutant">
  <compiler angle="radian" autolimits="true"/>
  <default><joint range="-2 2" damping="1"/><default class="slow"><joint range="-1 1"/></default></default>
  <include file="more.xml"/>
  <asset><mesh name="lost" file="lost.stl"/></asset>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="base" pos="0 0 0.1">
      <geom type="box" size="0.1 0.1 0.1"/>
      <body name="one" pos="0.1 0 0.2" euler="0.1 0.2 0.3" childclass="slow">
        <joint name="a" axis="0 0 1" pos="0 0 0.01"/>
        <inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
        <frame pos="0 0 0.3" axisangle="0 1 0 0.2">
          <body name="two" quat="1 0.5 0 0">
            <joint name="b" type="slide" axis="0 1 1" range="-0.3 0.4" ref="0.1"/>
            <body name="three" xyaxes="1 0 0 0 0 1"><joint name="c"/><site name="hand" pos="0 0 0.1"/></body>
          </body>
        </frame>
      </body>
      <replicate count="2" offset="0.1 0 0"><site name="mark"/></replicate>
    </body>
  </worldbody>
  <equality><joint joint1="a" joint2="c"/></equality>
  <actuator><motor joint="a"/></actuator>
  <keyframe><key qpos="0 0 0"/></keyframe>
</mujoco>
"""
MORE_MJCF = """<mujocoinclude><default><site size="0.01"/></default></mujocoinclude>
"""
BESIDE = {"more.xacro": MORE_XACRO, "more.xml": MORE_MJCF}
"""Files that the seeds include; they are mutated, too."""

NUMBERS = (
    *(
        "nan",
        "inf",
        "-inf",
        "1e308",
        "-1e308",
        "1e400",
        "1e200",
        "1e-320",
        "0",
        "-0.0",
        "1e9",
        "180",
        "-1",
        "2.5",
    ),
    *(
        "1_000",
        "0x10",
        "1,5",
        "٣",
        "",
        "1e",
        "--1",
        "9" * 400,
        "1 2",
        "True",
        "${1/0}",
        "${10**400}",
        "${[1]}",
    ),
)
WORDS = (
    *(
        "",
        " ",
        "link1",
        "link3",
        "base",
        "one",
        "a",
        "joint1",
        "world",
        "body 1",
        "joint 0",
        "fixed",
        "floating",
    ),
    *(
        "planar",
        "ball",
        "free",
        "hinge",
        "slide",
        "continuous",
        "prismatic",
        "true",
        "false",
        "auto",
        "é",
        "x" * 9999,
    ),
    *(
        "&",
        "<",
        '"',
        "${",
        "${name}",
        "${xacro.length}",
        "$(arg none)",
        "$(find none)",
        "$(env HOME)",
        "/",
        "../..",
        ".",
    ),
    *(
        "/dev/zero",
        "/dev/stdin",
        "more.xml",
        "more.xacro",
        "\u202e",
        "\U0001f916",
        "%s%n",
        "{0}",
        "\\",
        "a\tb",
    ),
)
TAGS = (
    *(
        "link",
        "joint",
        "robot",
        "limit",
        "mimic",
        "axis",
        "origin",
        "body",
        "site",
        "frame",
        "freejoint",
        "replicate",
    ),
    *(
        "default",
        "worldbody",
        "compiler",
        "include",
        "attach",
        "model",
        "asset",
        "mujoco",
        "inertial",
        "composite",
        "x",
    ),
    *(
        "{http://www.ros.org/wiki/xacro}" + word
        for word in ("macro", "if", "property", "include", "part", "insert_block")
    ),
)
ENTITIES = (
    '<!DOCTYPE r [<!ENTITY e SYSTEM "/dev/zero">]>',
    '<!DOCTYPE r [<!ENTITY e SYSTEM "file:///etc/hostname">]>',
    '<!DOCTYPE r [<!ENTITY % p SYSTEM "file:///dev/zero"> %p; <!ENTITY e "1">]>',
    '<!DOCTYPE r SYSTEM "/dev/zero">',
    '<!DOCTYPE r [<!ENTITY e "&e;">]>',
    '<!DOCTYPE r [<!ENTITY e "0">]>',
    '<!DOCTYPE r [<!ATTLIST link name CDATA "given">]>',
    "<!DOCTYPE r [<!ENTITY a0 'ha'>"
    + "".join(f"<!ENTITY a{i} '{f'&a{i - 1};' * 10}'>" for i in range(1, 12))
    + "<!ENTITY e '&a11;'>]>",
)
ENCODINGS = ("utf-16", "utf-16-le", "utf-32", "utf-8-sig", "utf-7", "cp500", "shift_jis", "latin-1")
ODD_BYTES = (
    b"\xff",
    b"\x00",
    b"\xed\xa0\x80",
    b"\xc0\x80",
    b"\xf4\x90\x80\x80",
    b"&#xD800;",
    b"&#0;",
    b"&#x10FFFF;",
)


class Case(NamedTuple):
    """One file to read."""

    name: str
    text: bytes
    beside: dict[str, bytes]
    """Files in the same folder."""


class Seed(NamedTuple):
    """A sound file to start from."""

    suffix: str
    text: bytes


def seeds(corpus: Path | None = None) -> list[Seed]:
    """The files that are mutated: every bundled arm, a xacro and an MJCF file, and those of a folder."""
    found = [Seed(".urdf", catalog_path(name).read_bytes()) for name in catalog_names()]
    made = [Seed(".xacro", XACRO.encode()), Seed(".xml", MJCF.encode())]
    for path in sorted(corpus.rglob("*") if corpus else ()):
        if path.suffix in (".urdf", ".xacro", ".xml"):
            (found if path.suffix == ".urdf" else made).append(Seed(path.suffix, path.read_bytes()))
    return found + made * max(1, len(found) // len(made))  # As many of each format.


def case(number: int, seed: int, from_: Sequence[Seed]) -> Case:
    """The file of this number: always the same."""
    random = Random(f"{seed}:{number}")
    start = random.choice(from_)
    text = start.text
    for _ in range(random.choice((1, 1, 1, 2, 3, 8))):
        text = random.choice(MUTATIONS)(random, text)
    beside = {name: words.encode() for name, words in BESIDE.items()}
    if random.random() < 0.2:
        name = random.choice(list(beside))
        beside[name] = random.choice(MUTATIONS)(random, beside[name])
    suffix = start.suffix if random.random() < 0.95 else random.choice((".urdf", ".xacro", ".xml", ".URDF"))
    return Case(f"case{suffix}", text, beside)


# By bytes


def flip(random: Random, text: bytes) -> bytes:
    """Change some bytes."""
    changed = bytearray(text)
    for _ in range(random.choice((1, 2, 10)) if changed else 0):
        changed[random.randrange(len(changed))] = random.randrange(256)
    return bytes(changed)


def cut(random: Random, text: bytes) -> bytes:
    """Leave a piece out, or the end."""
    a, b = sorted(random.randrange(len(text) + 1) for _ in range(2))
    return text[:a] + (text[b:] if random.random() < 0.7 else b"")


def put(random: Random, text: bytes) -> bytes:
    """Put odd bytes in, often into an attribute."""
    quotes = [m.end() for m in re.finditer(rb'="', text)]
    place = random.choice(quotes) if quotes and random.random() < 0.8 else random.randrange(len(text) + 1)
    return text[:place] + random.choice(ODD_BYTES) * random.choice((1, 1, 50)) + text[place:]


def repeat(random: Random, text: bytes) -> bytes:
    """Write a piece several times."""
    a, b = sorted(random.randrange(len(text) + 1) for _ in range(2))
    b = min(b, a + 2000)
    return text[:a] + text[a:b] * random.choice((2, 3, 100)) + text[b:]


def encode(random: Random, text: bytes) -> bytes:
    """Write it in another encoding, or only say so."""
    name = random.choice(ENCODINGS)
    if random.random() < 0.5:
        head = f'<?xml version="1.0" encoding="{random.choice((*ENCODINGS, "klingon", ""))}"?>'
        return head.encode() + re.sub(rb"^\s*<\?xml.*?\?>", b"", text, flags=re.DOTALL)
    return text.decode(errors="replace").encode(name, errors="replace")


def entities(random: Random, text: bytes) -> bytes:
    """Declare an entity, and use it."""
    bare = re.sub(rb"^\s*<\?xml.*?\?>", b"", text, flags=re.DOTALL)
    spots = [m.end() for m in re.finditer(rb'="|>', bare)]
    for _ in range(random.choice((0, 1, 3)) if spots else 0):
        place = random.choice(spots)
        bare = bare[:place] + b"&e;" + bare[place:]
    return random.choice(ENTITIES).encode() + bare


def number_in_text(random: Random, text: bytes) -> bytes:
    """Replace one number, wherever it stands."""
    spots = list(re.finditer(rb"-?\d+\.?\d*", text))
    if not spots:
        return text
    spot = random.choice(spots)
    return text[: spot.start()] + random.choice(NUMBERS).encode() + text[spot.end() :]


# By structure


def structural(change: Callable[[Random, Any, list[Any]], None]) -> Callable[[Random, bytes], bytes]:
    """Make a mutation of bytes from one of elements; what is no XML stays as it is."""

    def mutate(random: Random, text: bytes) -> bytes:
        try:
            root = etree.fromstring(
                text, etree.XMLParser(resolve_entities=False, remove_comments=True, remove_pis=True)
            )
            change(random, root, [e for e in root.iter() if isinstance(e.tag, str)])
            return bytes(etree.tostring(root))
        except (etree.LxmlError, ValueError, LookupError, TypeError):
            return text

    mutate.__name__ = change.__name__
    return mutate


@structural
def drop(random: Random, root: Any, elements: list[Any]) -> None:
    """Leave elements out."""
    for element in random.sample(elements[1:], min(len(elements) - 1, random.choice((1, 1, 3)))):
        if element.getparent() is not None:
            element.getparent().remove(element)


@structural
def duplicate(random: Random, root: Any, elements: list[Any]) -> None:
    """Write an element several times."""
    element = random.choice(elements[1:])
    for _ in range(random.choice((1, 1, 5, 200))):
        element.addnext(etree.fromstring(etree.tostring(element, with_tail=False)))


@structural
def move(random: Random, root: Any, elements: list[Any]) -> None:
    """Hang an element somewhere else."""
    element, onto = random.choice(elements[1:]), random.choice(elements)
    onto.insert(random.randrange(len(onto) + 1), element)


@structural
def nest(random: Random, root: Any, elements: list[Any]) -> None:
    """Put an element into itself, again and again."""
    element = random.choice(elements)
    inner = element
    for _ in range(random.choice((2, 10, 200, 2000))):
        inner = etree.SubElement(inner, element.tag, dict(element.attrib))


@structural
def many(random: Random, root: Any, elements: list[Any]) -> None:
    """Add thousands of bodies, links or joints, in a row or side by side."""
    count = random.choice((500, 3000, 12000))
    robot = root.tag == "robot"
    names = [e.get("name") for e in elements if e.tag == "link" and e.get("name")] or ["base"]
    above = random.choice(names)
    row = random.random() < 0.5
    kind = random.choice(("fixed", "revolute", "continuous"))
    bodies = root.find("worldbody")
    for i in range(count):
        if robot:
            etree.SubElement(root, "link", name=f"m{i}")
            joint = etree.SubElement(root, "joint", name=f"mj{i}", type=kind)
            etree.SubElement(joint, "parent", link=above if i == 0 or not row else f"m{i - 1}")
            etree.SubElement(joint, "child", link=f"m{i}")
            etree.SubElement(joint, "limit", lower="-1", upper="1")
            if kind == "revolute" and i and random.random() < 0.5:
                etree.SubElement(joint, "mimic", joint=f"mj{i - 1}")
        elif bodies is not None:
            etree.SubElement(etree.SubElement(bodies, "body", name=f"m{i}"), "joint")


@structural
def rename(random: Random, root: Any, elements: list[Any]) -> None:
    """Give an element another tag."""
    random.choice(elements).tag = random.choice(TAGS)


@structural
def attribute(random: Random, root: Any, elements: list[Any]) -> None:
    """Drop an attribute, or give it another value, another's value or a number from the edge."""
    for _ in range(random.choice((1, 1, 4))):
        element = random.choice([e for e in elements if e.attrib])
        name = random.choice(list(element.attrib))
        other = random.choice([e for e in elements if e.attrib])
        action = random.randrange(5)
        if action == 0:
            del element.attrib[name]
        elif action == 1:
            element.set(name, random.choice(list(other.attrib.values())))
        elif action == 2:
            element.set(name, random.choice(WORDS))
        elif action == 3:
            words = element.get(name).split() or [""]
            words[random.randrange(len(words))] = random.choice(NUMBERS)
            element.set(name, " ".join(words))
        else:
            element.set(random.choice(list(other.attrib)), random.choice((*WORDS, *NUMBERS)))


@structural
def add(random: Random, root: Any, elements: list[Any]) -> None:
    """Put a new element in, with attributes of others."""
    attributes = {
        name: value
        for e in random.sample(elements, min(3, len(elements)))
        for name, value in e.attrib.items()
    }
    if random.random() < 0.3:
        attributes |= {
            "count": random.choice(("3", "1000000000", "-1", "x")),
            "prefix": "p",
            "file": "more.xml",
        }
        attributes["filename"] = random.choice(("more.xacro", "/dev/zero", "case.xacro", "*.xacro"))
    element = etree.SubElement(random.choice(elements), random.choice(TAGS), attributes)
    if random.random() < 0.5:
        element.append(etree.fromstring(etree.tostring(random.choice(elements), with_tail=False)))


MUTATIONS: tuple[Callable[[Random, bytes], bytes], ...] = (
    *(flip, cut, put, repeat, encode, entities),
    *(number_in_text, drop, duplicate, move, nest, rename, attribute, attribute, add),
    *(drop, rename, attribute, number_in_text, move, add),
    *(many,),
)


# Judging


def judge(path: Path) -> str:
    """Read a file, and say how that ended: ``loaded``, ``refused``, or what is wrong."""
    try:
        chain = load(path)
    except KinseekError:
        return "refused"
    except BaseException:
        return "EXCEPTION " + traceback.format_exc()
    numbers = [chain.lower, chain.upper, chain.fixed, chain.multiplier, chain.offset]
    if not all(np.isfinite(array).all() for array in numbers):
        return "NOT FINITE"
    if not (chain.lower <= chain.upper).all():
        return f"CROSSED {chain.lower} {chain.upper}"
    turns = chain.fixed[:, :, :3]
    if np.abs(turns @ np.swapaxes(turns, 1, 2) - np.eye(3)).max() > 1e-4:
        return "NO ROTATION"
    if not len(chain.joint_names) == len(set(chain.joint_names)) == len(chain.lower) > 0:
        return "NAMES"
    return "loaded"


def load(path: Path) -> SerialChain:
    """Read a file; where the arm branches, up to a tip that the message names."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return read(path)
        except InvalidRobot as error:
            tips = re.search(r"Choose tip= from: ([^,;]+)", str(error))
            if tips is None or tips[1].startswith("none"):
                raise
            return read(path, tip=tips[1])


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
