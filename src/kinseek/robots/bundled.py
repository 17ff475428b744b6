"""Load bundled arms from preprocessed JSON files, without an XML parser.

    python -m kinseek.robots.prepare_catalog        # after a change in catalog/

Each ``NAME.urdf`` has a ``NAME.json`` with the exact result of the reader and a digest of the URDF file. If the digest does
not match the URDF file, the URDF file is read instead.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from kinseek.kernels.sources import digest_of

from .catalog import catalog_path
from .chain import Frame, SerialChain
from .mechanism import RATES

_WORDS = ("name", "base", "tip")
_FLOATS = ("lower", "upper", "fixed", "multiplier", "offset")


def read_bundled(name: str) -> SerialChain | None:
    """Return the chain of a bundled arm between its own base and tip, or None if there is no valid JSON file."""
    path = catalog_path(name)
    try:
        data = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    current = isinstance(data, dict) and data.get("digest") == _digest(path)
    return _chain(data, path) if current else None


def _chain(data: dict[str, Any], path: Path) -> SerialChain:
    given: dict[str, Any] = {word: data[word] for word in _WORDS}
    given |= {name: np.array(data[name], dtype=np.float64) for name in _FLOATS}
    return SerialChain(
        **given,
        joint_names=tuple(data["joint_names"]),
        kinds=tuple(data["kinds"]),
        rates=np.array([data[name] for name in RATES], dtype=np.float64),
        prismatic=np.array(data["prismatic"], dtype=np.bool_),
        leader=np.array(data["leader"], dtype=np.int64),
        source=str(path),
        urdf=path.read_bytes(),
        frames={
            name: Frame(joints, np.array([*rows, [0.0, 0.0, 0.0, 1.0]]))
            for name, (joints, rows) in data["frames"].items()
        },
    )


def as_json(chain: SerialChain, path: Path) -> dict[str, Any]:
    """Return the JSON content for a chain that was read from a file; numbers have as many digits as exact values need."""
    return {
        "digest": _digest(path),
        **{word: getattr(chain, word) for word in _WORDS},
        "joint_names": chain.joint_names,
        "kinds": chain.kinds,
        **{name: getattr(chain, name).tolist() for name in (*_FLOATS, "prismatic", "leader")},
        **{
            name: [None if np.isnan(value) else value for value in row]
            for name, row in zip(RATES, chain.rates.tolist(), strict=True)
        },
        "frames": {name: (frame.joints, frame.pose[:3].tolist()) for name, frame in chain.frames.items()},
    }


def _digest(path: Path) -> str:
    """Return the digest of a file's text, independent of its line ends."""
    return digest_of([path.read_text(encoding="utf-8").encode()])
