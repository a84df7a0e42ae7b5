"""What is told of points and errors in space."""
