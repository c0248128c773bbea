"""A scene or a chamber drawn to scale."""
