"""The cell: the arm's surroundings, its own body, and the proof that a motion touches neither.

`scene_files` reads scenes, `solids` measures distances between shapes, `bodies` and `pairs` say what must not touch,
`proof` proves this for every instant of a motion, and `planes` gives solvers constraints that lead to such motions.
"""
