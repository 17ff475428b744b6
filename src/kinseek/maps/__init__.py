"""Maps of what an arm reaches in its whole workspace, computed on one machine or on a cluster."""

from .base import best_base
from .cost import Estimate, estimate
from .grid import Grid, Rings
from .make import open_map as open
from .make import reach
from .orientations import Orientations, orientations
from .reading import Volume, at, capability, expand, volume

__all__ = [
    "Estimate",
    "Grid",
    "Orientations",
    "Rings",
    "Volume",
    "at",
    "best_base",
    "capability",
    "estimate",
    "expand",
    "open",
    "orientations",
    "reach",
    "volume",
]
