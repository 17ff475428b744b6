"""What an arm may hit: bodies and their shapes, the pairs of them that count, and answers that are free."""

from .scene import Scene
from .shapes import Box, Capsule, Cylinder, Mesh, Points, Shape, Sphere

__all__ = ["Box", "Capsule", "Cylinder", "Mesh", "Points", "Scene", "Shape", "Sphere"]
