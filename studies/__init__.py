"""One folder per design study: its spec, its analysis, its figures and its README."""
