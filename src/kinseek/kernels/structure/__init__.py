"""Closed forms of arms whose axes meet or run parallel."""
