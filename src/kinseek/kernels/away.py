"""Import Numba away from the working folder, whose settings file Numba would read.

`.numba_config.yaml` there may have been distributed with a robot description. It could name files to write, another
processor, and other machine code to keep. Numba's environment variables are respected as usual.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

from kinseek.support.private import NotPrivate, require_private


def _may_have_settings() -> bool:
    """Return whether the working folder has such a file, or another user can put one there before Numba looks."""
    try:
        require_private(Path.cwd(), os.stat(os.curdir))
    except NotPrivate:
        return True
    except OSError:  # It has been removed.
        return False
    return os.path.lexists(".numba_config.yaml")


with contextlib.chdir(Path(__file__).parent) if _may_have_settings() else contextlib.nullcontext():
    from numba.core import config

vars(config)["_config_fname"] = os.devnull
