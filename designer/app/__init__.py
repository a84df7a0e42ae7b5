"""What `design` and Python offer: a file a capability, with its result and how that is told."""
