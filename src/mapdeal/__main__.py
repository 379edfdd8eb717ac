"""Run the command line as ``python -m mapdeal``."""

from mapdeal.cli.process import run_process

if __name__ == "__main__":
    run_process()
