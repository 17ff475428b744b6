"""What notebooks show: a small table and a picture of an arm, an answer, branches or a proof; and tables for pandas.

Nothing is computed here. The functions take the objects of the rooms above, which import this room when a notebook asks.
"""
