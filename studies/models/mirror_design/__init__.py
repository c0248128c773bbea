"""The finger's camera and mirrors: layout, search, tolerances, yield."""
