"""`python -m breastscan` is the command line."""

from breastscan.cli import main

main()
