"""The arm itself: forward kinematics, derivatives, and how far a pose is from a goal."""
