"""How well hypotheses explain the data: evidence (`odds`), errors beside the noise, and what the residual follows."""
