"""Collision scenes: bodies and their shapes, the pairs that are checked, and collision-free solutions."""

from .clouds import Points, Voxels
from .scene import Scene
from .shapes import Box, Capsule, Cylinder, Mesh, Shape, Sphere

__all__ = ["Box", "Capsule", "Cylinder", "Mesh", "Points", "Scene", "Shape", "Sphere", "Voxels"]
