"""Triangles of mesh files: STL, OBJ, PLY, GLB and COLLADA, each with its own reader, under common limits."""
