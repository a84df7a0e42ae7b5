"""What the pages of all folders share."""
