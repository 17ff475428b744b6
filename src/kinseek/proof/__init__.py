"""Prove that goals are out of reach, bound the least error of an arm, and prove that a list of solutions is complete."""
