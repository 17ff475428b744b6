"""One solver a module, as `benchmarks.field.protocol` describes it, with its requirements beside it."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from typing import cast

from benchmarks.field.protocol import Adapter

HERE = Path(__file__).resolve().parent

SOLVERS = (
    *("kinseek", "eaik", "ssik", "robotics_toolbox", "trac_ik", "optik"),
    *("pinocchio", "pink", "mink", "drake", "ikpy", "kdl", "pyroki"),
)
"""In the order in which they are measured."""

NEEDED = ("NAME", "PACKAGE", "RECOMMENDED", "SWEEP", "load")


def adapter(path: Path) -> Adapter:
    """Import an adapter from its file; ValueError if something is missing."""
    specification = importlib.util.spec_from_file_location(f"field_adapter_{path.stem}", path)
    if not path.is_file() or specification is None or specification.loader is None:
        raise ValueError(
            f"{path}: no such adapter; there are {', '.join(SOLVERS)}, or give the path of a .py file"
        )
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    missing = [name for name in NEEDED if not hasattr(module, name)]
    if missing:
        raise ValueError(f"{path}: an adapter needs {', '.join(NEEDED)}; missing: {', '.join(missing)}")
    return cast(Adapter, module)


def path_of(name: str) -> Path:
    """File of an adapter whose requirements are in this folder, or of one that lies elsewhere.

    Peers of other benchmarks have only requirements here.
    """
    return HERE / f"{name}.py" if (HERE / f"{name}.txt").is_file() else Path(name).resolve()
