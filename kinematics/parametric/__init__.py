"""A linkage as named distances: what ``designopt optimise`` and ``designopt explore`` change."""
