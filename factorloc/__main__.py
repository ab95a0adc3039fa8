"""``python -m factorloc``: the command line."""

from factorloc.cli import main

main()
