"""Several robots in one periodic cycle: job files of format 2, their schedule, and the saving of each lever.

`file` reads the request, `arm` and `curves` give energy against duration for each move, `stage` and `arrange` schedule
them with one lever after the other, `between` proves that arms keep apart and `around` leads moves around other arms,
`supply` sums the power, `plan` and `solve_cell` join all this, and `cell_files` and `programs` write it.
"""
