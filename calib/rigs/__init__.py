"""From what many cameras saw of one target to where each stands: the joint adjustment, and how sure it is."""
