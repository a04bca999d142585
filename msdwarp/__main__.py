"""The command as `python -m msdwarp`."""

from .cli import main

main()
