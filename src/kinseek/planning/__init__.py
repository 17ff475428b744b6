"""Motions around obstacles: the implementation of `Scene.plan`."""
