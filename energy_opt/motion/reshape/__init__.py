"""Minimum energy over path and timing together.

A move is a quintic B-spline q(u), u = t / T, whose control points and duration T are the unknowns. The energy is a sum
over Gauss nodes (direct collocation); limits hold at nodes, at control points of derivatives, and at places of the
curve. `layout` and `nodes` state the problem, `evaluation` and `model` linearise it, `sqp` and `polish` solve it from
one curve, `starts` and `search` choose the curves, and `clear` keeps them clear of bodies.
"""
