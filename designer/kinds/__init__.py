"""The kinds of targets, a file each; `designer.kind` lists them."""
