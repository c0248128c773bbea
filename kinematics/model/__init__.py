"""A linkage: its dimensions, and who is joined to whom."""
