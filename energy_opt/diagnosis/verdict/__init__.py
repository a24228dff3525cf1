"""What is claimed: the verdict, its judge on held-out motions, findings, and whether the model is usable."""
