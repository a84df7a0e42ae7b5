"""Photos as files: their pixels as the sensor saw them, what their headers say, and whether they are whole."""
