"""First tests of a scene: configurations that are certainly free or certainly in collision."""
