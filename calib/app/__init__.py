"""A capability a file: what it gives, the function, how it is told; `calib.cli` lists them."""
