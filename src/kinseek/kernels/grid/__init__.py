"""Windows of grids, and exact minima along joints: what the paper's searches are made of."""
