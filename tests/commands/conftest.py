"""Command lines as they are typed, as for the tests of the command line itself."""

from cli.conftest import _shown_on_terminal, here, room, sh

__all__ = ["_shown_on_terminal", "here", "room", "sh"]
