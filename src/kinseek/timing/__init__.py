"""Motions in time: paths that are run as fast as the limits of speed, acceleration and jerk allow."""
