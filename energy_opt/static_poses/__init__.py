"""The source paper's two methods of identification from static poses (Petrichenko et al. 2024, arXiv 2411.03194)."""
