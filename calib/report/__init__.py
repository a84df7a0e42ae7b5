"""The page of a folder of results: built from what the folder stores, and from nothing else."""
