"""The search from sorted samples to a solution: look-up, refinement in eight lanes, and unreachable goals."""
