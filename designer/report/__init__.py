"""The page of a design's folder: the target in 3D, how to print it, and what to measure of it."""
