"""The source paper's two methods of identification from static poses (Petrichenko et al. 2024, arXiv 2411.03194)."""

from energy_opt.static_poses.methods import Identification, Pose, identify, poses_of
from energy_opt.static_poses.suggest import Suggestion, suggest

__all__ = ["Identification", "Pose", "Suggestion", "identify", "poses_of", "suggest"]
