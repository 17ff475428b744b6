"""The arm: forward kinematics, derivatives, and errors of poses."""
