"""Windows of grids, and exact minima along joints: the building blocks of the paper's searches."""
