"""Tracing the residual of measured power to the effect that the declared model lacks."""
