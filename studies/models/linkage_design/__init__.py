"""The finger's linkage: requirements, search, and what is found of it."""
