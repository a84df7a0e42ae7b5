"""What a target is asked to be: its kind, its options, its sizes and their rules."""
