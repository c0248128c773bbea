"""What of every pad the camera sees, by which path, how large and how sharp."""
