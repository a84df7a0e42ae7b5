"""Photos as they are taken: sources, the folder they are written to, and the page that guides the person."""
