"""The atlas: the default search."""
