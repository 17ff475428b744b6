"""How hypothesis runs here.

No deadline: the first example of a test may compile a kernel, and a busy machine is no failure. With CI set the examples
are the same in every run; elsewhere they are new ones each time, and a failure prints how to get it again.
"""

from __future__ import annotations

import os

from hypothesis import settings

settings.register_profile("kinseek", deadline=None, print_blob=True)
settings.register_profile("kinseek-ci", settings.get_profile("kinseek"), derandomize=True)
settings.load_profile("kinseek-ci" if os.environ.get("CI") else "kinseek")
