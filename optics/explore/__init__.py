"""A scene or a chamber with sliders: what ``designopt explore`` shows of them."""
