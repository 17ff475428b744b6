"""Notebook output: a small table and a picture of an arm, a solution, branches or a proof.

This package computes no results. Its functions take the objects of other packages, which import it when a notebook displays
them.
"""
