"""What a person calls from Python: typed functions that take and return values, and print nothing."""
