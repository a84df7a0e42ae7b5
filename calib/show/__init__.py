"""What people see: results as blocks, and blocks as lines of a terminal."""
