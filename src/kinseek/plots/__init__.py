"""Pictures of arms, solutions, searches and proofs with Matplotlib (extra ``plot``).

>>> from kinseek import plots
>>> figure = plots.branches(arm.branches(target))   # doctest: +SKIP
>>> plots.save(figure, "branches.png")              # doctest: +SKIP

Every function returns a Matplotlib figure; functions with ``ax=`` can draw on given axes. They show their arguments: a
solution, a trace, a certificate, joint values. If a picture needs further computations, such as a landscape of errors, an
argument limits them. docs/plots.md shows all pictures.

`space`, `plane`, `draw_arm`, `draw_frame`, `draw_line`, `same_scale` and `trim` help to make other pictures.
"""

from __future__ import annotations

from .arms import arm, branches, draw_arm, draw_frame, draw_line
from .atlases import samples
from .figures import COLOURS, plane, same_scale, save, space, trim
from .landscapes import landscape, passes, windows
from .maps import bases, cloud, map_slice, volumes
from .paths import joints
from .proofs import boxes
from .traces import breadths, circles, progress, tree
from .trajectories import trajectory
from .workspaces import workspace

__all__ = [
    "COLOURS",
    "arm",
    "bases",
    "boxes",
    "branches",
    "breadths",
    "circles",
    "cloud",
    "draw_arm",
    "draw_frame",
    "draw_line",
    "joints",
    "landscape",
    "map_slice",
    "passes",
    "plane",
    "progress",
    "same_scale",
    "samples",
    "save",
    "space",
    "trajectory",
    "tree",
    "trim",
    "volumes",
    "windows",
    "workspace",
]
