"""Goals with free axes and ranges: their steps, and their search in the atlas."""
