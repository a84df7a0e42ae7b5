"""Pages of plans of photos."""
