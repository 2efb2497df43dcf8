"""What a door says when it is handed something it cannot use."""

from __future__ import annotations


class InputError(Exception):
    """Input that cannot be used: its text is one line that names the input and what is wrong with it."""
