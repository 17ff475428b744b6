"""Random questions by the ten thousand: each module runs by itself, as ``python -m tests.fuzz.NAME``."""
