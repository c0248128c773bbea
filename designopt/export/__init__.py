"""``designopt export``: a design as a drawing, a simulation model or numbers."""
