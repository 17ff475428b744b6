"""Compile kernels that an editable install skipped, and load the library that then contains them too."""

from __future__ import annotations

import os
import subprocess
import sys
from importlib.util import module_from_spec, spec_from_file_location
from typing import Any

from kinseek.errors import KinseekError
from kinseek.support.notices import notice

from .sources import ALL, PACKAGE

BUILD = PACKAGE.parents[1] / "native" / "build.py"


def with_room(door: Any, room: str) -> Any:
    """Compile a folder of kernels, or all of them, and load the library again.

    Args:
        door: The library as this process has loaded it.
        room: Name of the folder, or `ALL`.

    Returns:
        The library that contains this folder as well.

    Raises:
        KinseekError: It cannot be compiled, or the sources of the kernels have changed since this process began.
    """
    folder, name = os.path.split(door.__file__)
    command = [sys.executable, str(BUILD), folder, "--levels", *door.levels.split()]
    notice(f"compiling kernels ({room}), which takes up to a minute, once")
    done = subprocess.run(
        command if room == ALL else [*command, "--rooms", room],
        # In a working folder that was distributed with a robot, Numba would read a settings file.
        cwd=folder,
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
    # For a known path the system's loader returns the file that it has loaded already, so this path is another one.
    spec = spec_from_file_location(door.__name__, os.path.join(folder, os.curdir, name))
    assert spec is not None
    assert spec.loader is not None
    made = module_from_spec(spec)
    spec.loader.exec_module(made)
    if made.digest != door.digest:
        raise KinseekError("the sources of the kernels have changed since this process began: start it again")
    return made
