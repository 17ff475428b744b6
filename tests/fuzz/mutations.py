"""How files are mutated: bytes, numbers, words and lines of any text, and the elements of XML."""

from __future__ import annotations

import re
from collections.abc import Callable
from random import Random
from typing import Any

from lxml import etree

Mutation = Callable[[Random, bytes], bytes]

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
PLAIN_WORDS = (
    *("null", "true", "NaN", "-Infinity", "1e999", "[]", "{}", '""', "[[]]", "[", "}", ",", ":", "9" * 5000),
    *(
        "x",
        "qw",
        "m00",
        "rx",
        "roll",
        "pose",
        "near",
        "kinds",
        "R",
        "P",
        "Q",
        "*",
        ".",
        "mesh",
        "box",
        "100000000",
        "-1",
    ),
)
"""For tables, lists and lines."""
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


def word_in_text(random: Random, text: bytes) -> bytes:
    """Replace one word or sign by another one of the text, or by an odd one."""
    spots = list(re.finditer(rb"\w+|[^\w\s]", text))
    if not spots:
        return text
    spot = random.choice(spots)
    other = random.choice(spots)[0] if random.random() < 0.5 else random.choice(PLAIN_WORDS).encode()
    return text[: spot.start()] + other + text[spot.end() :]


def line(random: Random, text: bytes) -> bytes:
    """Leave a line out, or write it elsewhere, a few times or very often."""
    lines = text.splitlines(keepends=True)
    if not lines:
        return text
    chosen = lines.pop(random.randrange(len(lines)))
    place = random.randrange(len(lines) + 1)
    lines[place:place] = [chosen] * random.choice((0, 0, 1, 2, 2000))
    return b"".join(lines)


# By structure


def structural(change: Callable[[Random, Any, list[Any]], None]) -> Mutation:
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


MANY = (50, 500, 3000, 12000), (20, 8, 2, 1)
"""Bodies that are added, and how often: the large ones take seconds to read, more than all other mutations."""


@structural
def many(random: Random, root: Any, elements: list[Any]) -> None:
    """Add thousands of bodies, links or joints, in a row or side by side."""
    count = random.choices(*MANY)[0]
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


OF_TEXT: tuple[Mutation, ...] = (flip, cut, put, repeat, encode, number_in_text)
"""Of any file."""
OF_XML: tuple[Mutation, ...] = (
    *(*OF_TEXT, entities, drop, duplicate, move, nest, rename, attribute, attribute, add),
    *(drop, rename, attribute, number_in_text, move, add),
    *(many,),
)
OF_OTHERS: tuple[Mutation, ...] = (
    *OF_TEXT,
    number_in_text,
    number_in_text,
    word_in_text,
    word_in_text,
    line,
    line,
)
"""Of tables, lists and lines."""
