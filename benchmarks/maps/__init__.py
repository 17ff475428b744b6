"""Maps: what a pose costs, what Dask adds, what is proved, and maps that are sampled beside ours."""
