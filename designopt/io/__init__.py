"""What people write and read: TOML, CSV, values on the command line, folders, safe writing."""
