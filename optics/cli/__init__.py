"""The command ``designopt trace``."""
