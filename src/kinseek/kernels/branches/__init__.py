"""Every answer to a goal."""
