"""Compiles kernels that an editable install left for later, and loads the library that then has them too."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from typing import Any

from kinseek.errors import KinseekError

from .sources import PACKAGE

BUILD = PACKAGE.parents[1] / "native" / "build.py"


def with_room(door: Any, room: str) -> Any:
    """Have a folder of kernels compiled, or all of them, and load the library anew.

    Args:
        door: The library as this process has loaded it.
        room: Name of the folder, or "all".

    Returns:
        The library that has this folder as well.

    Raises:
        KinseekError: It cannot be compiled, or the sources of the kernels have changed since this process began.
    """
    folder, name = os.path.split(door.__file__)
    command = [sys.executable, str(BUILD), folder, "--levels", *door.levels.split()]
    print(
        f"kinseek: compiling kernels ({room}), which takes up to a minute, once", file=sys.stderr, flush=True
    )
    done = subprocess.run(
        command if room == "all" else [*command, "--rooms", room],
        cwd=folder,  # In a working folder that came with a robot, Numba would obey a file of settings.
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        check=False,
    )
    if done.returncode:
        raise KinseekError(
            f"kernels ({room}) are not compiled yet, and cannot be: {done.stderr.strip()[-500:] or done.returncode}. Numba "
            "(pip install 'kinseek[jit]') and a C compiler are needed"
        )
    # The system's loader takes a path that it knows for the file that it has loaded, so this one is another.
    spec = spec_from_file_location(door.__name__, os.path.join(folder, os.curdir, name))
    assert spec is not None
    assert spec.loader is not None
    made = module_from_spec(spec)
    spec.loader.exec_module(made)
    if made.digest != door.digest:
        raise KinseekError("the sources of the kernels have changed since this process began: start it again")
    return made
