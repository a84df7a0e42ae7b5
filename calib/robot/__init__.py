"""Where a robot held the camera or the target: its poses, in the ways that controllers write them."""
