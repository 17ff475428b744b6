"""How hypothesis runs here.

Nothing is timed: the first example of a test may compile a kernel, and a busy machine is no failure. With CI set the
examples are the same in every run; elsewhere they are new ones each time, and a failure prints how to get it again.
"""

from __future__ import annotations

import os

from hypothesis import HealthCheck, settings

settings.register_profile(
    "kinseek",
    deadline=None,
    print_blob=True,
    derandomize=bool(os.environ.get("CI")),
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("kinseek")
