"""Closed forms of arms with intersecting or parallel axes."""
