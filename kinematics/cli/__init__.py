"""The command ``designopt solve``."""
