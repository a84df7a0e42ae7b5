"""Writers of the files a person makes the target from, one format per file."""
