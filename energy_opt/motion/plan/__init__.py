"""From a move to its result.

`planner` checks a move and finds its first path, `candidates` and `clear` search for motions, `choice` judges them and
the baselines alike and takes the valid one of least energy. `single` does this at one duration, `neighbour` at several,
`robust` under several models at once.
"""
