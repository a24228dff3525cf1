"""Motion: paths, timings, trajectories, and their optimization for minimum energy."""
