"""Independent references in NumPy, SciPy and mpmath; nothing here imports the library."""
