"""Many poses in a row: one continuous motion through them, and a tracker that takes them one at a time."""
