"""Initial paths: free paths from start to goal if the straight line is not free.

They are starts, not answers. `find` bends the straight line through seeded poses, and asks OMPL (`ompl`) if that fails;
`polyline` shortens bent lines and rounds their corners, so that they can be timed; `room` checks poses and proves
paths.
"""

from energy_opt.motion.initial_paths.find import Free, InitialPath, find_paths

__all__ = ["Free", "InitialPath", "find_paths"]
