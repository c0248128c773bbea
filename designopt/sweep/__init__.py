"""``designopt sweep``: a study over many points, on this machine's cores or on a cluster."""
