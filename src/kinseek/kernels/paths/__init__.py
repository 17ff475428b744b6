"""Many poses in a row: branches followed, the best way through them, and one step of a tracker."""
