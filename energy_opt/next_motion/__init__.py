"""The motion to record next: within limits, and such that rival models differ most on it."""
