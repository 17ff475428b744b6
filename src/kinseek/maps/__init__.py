"""Maps: what an arm reaches of its whole workspace, on a laptop or on a cluster."""

from .grid import Grid, Rings
from .orientations import Orientations, orientations
from .reach import open_map as open
from .reach import reach

__all__ = ["Grid", "Orientations", "Rings", "open", "orientations", "reach"]
