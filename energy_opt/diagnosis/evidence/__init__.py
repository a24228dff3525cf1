"""How well hypotheses explain the data: evidence, errors, and what remains."""
