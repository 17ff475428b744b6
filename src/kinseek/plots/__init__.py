"""Pictures of arms and of searches with Matplotlib (extra ``experiments``).

Nothing is computed here but where joints are, and how far off a goal is.

>>> from kinseek import plots
>>> figure, axes = plots.space()                    # doctest: +SKIP
>>> plots.draw_arm(axes, arm, solution.q)           # doctest: +SKIP
>>> plots.save(figure, "arm.png")                   # doctest: +SKIP

Of a solution with a trace, ``arm.ik(..., trace=True)``: `tree`, `circles` and `breadths` are Figures 1 to 3 of the paper as
pictures of a real search, `windows` shows a search closing in on its answer, and `progress` sets any searches side by side.
"""

from __future__ import annotations

from .arms import COLOURS, draw_arm, draw_frame, draw_line, plane, same_scale, save, space
from .traces import breadths, circles, progress, tree, windows

__all__ = [
    "COLOURS",
    "breadths",
    "circles",
    "draw_arm",
    "draw_frame",
    "draw_line",
    "plane",
    "progress",
    "same_scale",
    "save",
    "space",
    "tree",
    "windows",
]
