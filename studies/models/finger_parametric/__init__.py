"""A whole finger as named numbers: parameters, measures, and the requirements of its studies."""
