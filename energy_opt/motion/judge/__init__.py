"""Proofs about a trajectory, from its samples alone: its energy and its limits.

The judge shares only the power laws with the solvers: torque comes from Pinocchio, and the laws are not smoothed.
`energy` integrates the power, `certificate` looks for the worst place under every limit on a dense grid, `proven`
extends this to the curve between the places by the bounds of `analytic` and `enclosure`, and `clearance` asks the cell.
"""
