"""From a target's geometry to what is made of it: ink, solids, sheets, stands, and whether a printer can make them."""
