"""Run the command line as ``python -m mapdeal``."""

from mapdeal.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
