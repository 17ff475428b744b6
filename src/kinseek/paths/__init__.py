"""Follow many poses by one continuous motion, or track poses that arrive one at a time."""
