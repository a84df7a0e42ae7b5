"""What cameras that are held together measure in space: points, their covariances, and what is to be expected."""
