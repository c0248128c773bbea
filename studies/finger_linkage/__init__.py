"""The linkage of paper B's finger, designed for the best force transmission."""
