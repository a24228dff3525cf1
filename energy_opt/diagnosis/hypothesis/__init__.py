"""What may be missing: terms of effects with their priors, and deviating links."""
