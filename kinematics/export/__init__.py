"""A linkage for other programs: a drawing to scale, a MuJoCo model."""
