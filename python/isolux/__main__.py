"""`python -m isolux`, for hosts that have the package and no `isolux` command on their path."""

from .cli import main

main()
