"""Strict readers of the shapes of mesh files, which share nothing with kinseek's, to judge them: `JUDGES`, by extension.

Each reads what the specification of its format describes, and raises `Unknown` for the rest. A reader for judging is simple
first: it may be slow, and it need not say where a fault is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from . import collada, glb, text_meshes
from .shapes import Polygons, Unknown

JUDGES: Mapping[str, Callable[[bytes], Polygons]] = {
    "dae": collada.polygons,
    "glb": glb.polygons,
    "obj": text_meshes.obj_polygons,
    "ply": text_meshes.ply_polygons,
    "stl": text_meshes.stl_polygons,
}

__all__ = ["JUDGES", "Polygons", "Unknown"]
