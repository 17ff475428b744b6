"""Processes that stay alive, each in an environment of its own, and answer one call at a time."""
