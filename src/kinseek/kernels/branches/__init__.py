"""Search for all solutions of a goal."""
