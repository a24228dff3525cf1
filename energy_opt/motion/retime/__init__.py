"""Minimum energy over the timing of a fixed path q(s).

The unknown is the squared path speed b(s) = (ds/dt)^2, a quadratic B-spline. With the path acceleration a = b'/2, the
rigid body's torque is affine in (a, b), and the energy is the integral of P(a, b) / sqrt(b) over s. It is convex if the
model's effects allow it, and its least value can then be bounded from below. `sums` and `points` give the integrand,
`quadrature` the sum over points, `limits` the constraints, `nlp` the program for IPOPT, `program` its solution and
proof, `solve` what is solved for a given duration, and `fastest` the minimum time.
"""
