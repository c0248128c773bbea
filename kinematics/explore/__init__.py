"""A linkage with sliders: what ``designopt explore`` shows of it."""
