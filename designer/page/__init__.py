"""The page that every report is: blocks of plain data, and one shell that turns them into a single HTML file."""
