"""Error against run time, beside other methods."""
