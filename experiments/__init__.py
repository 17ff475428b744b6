"""The paper's Section 4, run again: a file for each figure, open question, and claim that needs its own."""
