"""Measured data in the form that the fit uses: samples, repeats of motions, noise, and predictions of a model."""
