"""Every branch of a goal, and which of them to choose."""
