"""Initial paths: free paths from start to goal if the straight line is not free."""

from energy_opt.motion.initial_paths.find import Free, InitialPath, find_paths

__all__ = ["Free", "InitialPath", "find_paths"]
