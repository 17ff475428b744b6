"""Every solver of inverse kinematics that can be installed, on the same arms, asked the same, judged from outside."""
