"""What a made target may differ in from its drawing: error sources, models of a way of making, perturbed targets."""
