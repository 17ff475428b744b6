"""Import Numba away from the working folder, whose settings file Numba would read.

`.numba_config.yaml` there may have been distributed with a robot description. It could name files to write, another
processor, and other machine code to keep. Numba's environment variables are respected as usual.
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
