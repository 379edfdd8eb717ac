"""The command line: the only place with typer, the terminal and exit codes."""
