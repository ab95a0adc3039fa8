"""Command line: ``factorloc map build | localize | evaluate | info | demo``."""

__all__ = ["main"]


def main() -> None:
    """Run the command line; errors made on purpose are one line and exit code 1."""
    from factorloc.cli.app import run

    run()
