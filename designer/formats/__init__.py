"""The files of a design: a file here for each format."""
