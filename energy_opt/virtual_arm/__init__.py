"""The virtual arm: measured data with known causes, from a forward simulation independent of the library's laws.

`simulate` plays motions on an arm whose drives have a plant's effects.
MuJoCo (extra `sim`) is imported when an arm is built, not before.
"""
