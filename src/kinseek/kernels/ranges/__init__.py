"""Goals with free axes and ranges: the steps and the search of the atlas for them."""
