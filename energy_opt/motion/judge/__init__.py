"""What is proven of a trajectory: its energy and its limits, from its samples alone."""
