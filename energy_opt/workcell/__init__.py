"""Several robots in one periodic cycle: job files of format 2, their schedule, and the saving of each lever."""
