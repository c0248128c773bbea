"""``python -m designopt``."""

from designopt.cli import main

main()
