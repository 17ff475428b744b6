"""From sorted samples to an answer: lookup, refinement in eight lanes, and what happens out of reach."""
