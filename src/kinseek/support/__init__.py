"""What every room needs: checks of arguments, deadlines, caches, interrupts, forks, rotations. No user meets it."""
