"""A linkage to turn and to drag: what ``designopt explore`` shows of it."""
