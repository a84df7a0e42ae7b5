"""The kinds of targets, a file each; `designer.spec.kind` lists them."""
