"""Imports Numba away from the working folder, where it would obey a file of settings.

`.numba_config.yaml` there may have come with somebody's robot. It could name files to write, another processor, and other
machine code to keep. Numba's environment variables count as ever.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

with (
    contextlib.chdir(Path(__file__).parent)
    if os.path.lexists(".numba_config.yaml")
    else contextlib.nullcontext()
):
    from numba.core import config

vars(config)["_config_fname"] = os.devnull
