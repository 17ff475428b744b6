"""Compile the kernels while the package is built (native/build.py), or say why they will be compiled where it runs."""

from __future__ import annotations

import os
import runpy
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
KERNELS = ROOT / "src" / "kinseek" / "kernels"


def _levels() -> list[int] | None:
    """Levels of the processor that a wheel is for, None for all."""
    words = os.environ.get("KINSEEK_LEVELS", "").split()
    if not all(word.isdecimal() for word in words):
        raise ValueError(f"KINSEEK_LEVELS must be numbers such as '2 3', got {' '.join(words)!r}")
    return sorted({int(word) for word in words}) or None


class CompiledKernels(BuildHookInterface):  # type: ignore[misc,type-arg,unused-ignore]
    """Puts the library of kernels beside their sources, and so into the wheel."""

    PLUGIN_NAME = "custom"

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Build it.

        An editable install gets the level of this machine alone, since nobody else runs it, and at first only the kernels
        of forward and inverse kinematics. The others are compiled when they are first called, so it depends on Numba.
        """
        mode = os.environ.get("KINSEEK_BUILD", "auto")
        if mode not in ("auto", "always", "never"):
            raise ValueError(f"KINSEEK_BUILD must be 'auto', 'always' or 'never', got {mode!r}")
        if mode == "never":
            return self._without(build_data, "KINSEEK_BUILD=never")
        try:
            native = runpy.run_path(str(ROOT / "native" / "build.py"))
            editable = version == "editable"
            first = editable and mode == "auto"
            levels = native["this_level"]() if editable else _levels()
            library = native["build"](KERNELS, levels, native["FIRST"] if first else ())
        except Exception as error:
            if mode == "always":
                raise
            return self._without(build_data, f"{type(error).__name__}: {error}")
        if first:
            build_data["dependencies"] += self.metadata.core.optional_dependencies["jit"]
        build_data["pure_python"] = False
        build_data["artifacts"].append(f"src/kinseek/kernels/{library.name}")
        build_data["tag"] = f"cp311-abi3-{native['platform_tag'](library)}"
        return None

    def _without(self, build_data: dict[str, Any], why: str) -> None:
        """Build a package of Python files alone: Numba compiles the kernels where it runs."""
        self.app.display_warning(
            f"kinseek: kernels are not compiled now ({why}); kinseek[jit] compiles them later"
        )
        for stale in KERNELS.glob("_prebuilt.*"):
            stale.unlink()
