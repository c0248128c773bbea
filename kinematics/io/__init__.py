"""From a sketch in a file to an assembled linkage."""
