"""Any design's file improved in one measure: the function `optimise`, its study and its command."""
