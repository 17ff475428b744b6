"""Paths: are they followed without a break, with which steps, how fast, and how do other solvers fare?

Made paths are random smooth curves of joint values, four harmonics over 98 % of every range, 1,000 poses; so a motion
without a break exists, and its largest step is known. `arm.follow` gets only the poses, and a `max_step` of 1.5 times that
step. A path is followed if it has no break and if every pose is reached to 1e-6 by plain forward kinematics, inside the
limits. Times are processor times of one thread if nothing else is said.

A part that is done is kept in `build/benchmarks`, so what is stopped goes on there; the page is written when all are done.

    python -m benchmarks.paths                      # writes benchmarks/paths.md
    python -m benchmarks.paths --only peers         # this part anew, and the page if the others are there
    python -m benchmarks.paths ur5e panda --quick   # a few of each, printed and not written
"""

from __future__ import annotations

from benchmarks.command import command
from benchmarks.page import in_parts
from benchmarks.workers.motion import FOLLOWERS

from .followed import long, made, tasks
from .peers import IKLINK, peers
from .proofs import proofs

PARTS = {"made": made, "tasks": tasks, "peers": peers, "proofs": proofs, "long": long}


def main() -> None:
    """Measure and write the page."""
    parser = command(
        __file__,
        __doc__,
        arms=(),
        page="paths.md",
        paths=(100, 2, "made paths, and paths with a jump, an arm"),
        placements=(50, 2, "placements of each task"),
        poses=(
            100_000,
            4_000,
            "poses of a long path; a stream has ten times as many, a redundant arm a fifth",
        ),
    )
    parser.add_argument("--only", nargs="*", choices=PARTS, default=(), help="parts; all of them by default")
    parser.add_argument("--peers", nargs="*", choices=FOLLOWERS, default=list(FOLLOWERS), help="names")
    parser.add_argument("--iklink", default=IKLINK, help="repository of IKLink, its raw address or a folder")
    in_parts("Paths", "benchmarks.paths", __doc__, PARTS, parser.options())


if __name__ == "__main__":
    main()
