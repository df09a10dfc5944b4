"""`python -m walkerkit.gap` is the program `walkerkit`."""

from walkerkit.gap.cli import main

main()
