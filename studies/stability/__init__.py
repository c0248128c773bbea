"""Extreme cases against references in 50 digits and brute force."""
