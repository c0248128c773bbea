"""``python -m designopt``, which imports nothing from the folder it is started in."""

import sys
from pathlib import Path

# Python puts that folder first, where somebody's optics.py or numpy.py would be imported. In a
# checkout it is the folder of this package itself.
if not sys.flags.safe_path and Path(sys.path[0]) != Path(__file__).parents[1]:
    del sys.path[0]

from designopt.cli import main

main()
