"""Files of robots for tests, made of parts, and limits of time."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

XACRO = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">{}</robot>'
MODEL = "<mujoco>{}<worldbody><body name='b'><joint name='j'/>{}</body></worldbody></mujoco>"
LIMIT = '<limit lower="-1" upper="2"/>'


def link(name: str, inside: str = "") -> str:
    """URDF of a link."""
    return f'<link name="{name}">{inside}</link>'


def joint(name: str = "j", ends: str = "a b", kind: str = "revolute", inside: str = LIMIT) -> str:
    """URDF of a joint from one link to another."""
    parent, child = ends.split()
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{inside}</joint>'
    )


def robot(*inside: str, links: str = "a b c", name: str = "r") -> str:
    """URDF of a robot with links of these names, and whatever else is inside."""
    return f'<robot name="{name}">{"".join(map(link, links.split()))}{"".join(inside)}</robot>'


SECOND = joint("k", "b c", "fixed", "")
TURNING = joint(kind="continuous", inside="")
"""A joint without limits from link a to link b."""


@contextmanager
def soon(seconds: float = 10.0) -> Iterator[None]:
    """Fail if what is inside takes longer than so many seconds of the processor."""
    begin = time.process_time()
    yield
    assert time.process_time() - begin < seconds


def write(folder: Path, name: str, text: str | bytes) -> Path:
    """Write a file; the path of it."""
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path
