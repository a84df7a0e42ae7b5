"""How targets are built: a file a build, each with a `MAKER`; what they are is listed in `designer.spec.build`."""
