"""The fit of one hypothesis, and the candidates for one more effect."""
