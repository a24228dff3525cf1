"""What was measured, as the fit sees it: samples, repeats of motions, noise, and what a model predicts for them."""
