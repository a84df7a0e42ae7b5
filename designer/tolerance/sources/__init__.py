"""The error sources, one a file; `designer.tolerance.registry` names them all."""
