"""Proofs: what no joint values can reach, how near the arm can come, and that there is no further answer."""
