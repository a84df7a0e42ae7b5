"""What a measured target says to the person who printed it: words, tables, a picture and files."""
