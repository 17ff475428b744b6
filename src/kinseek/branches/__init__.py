"""Find all branches of a goal, and choose among them."""
