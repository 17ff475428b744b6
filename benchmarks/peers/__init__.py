"""Other inverse kinematics on the same targets, each from its wheel."""
