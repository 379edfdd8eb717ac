"""Words that are spelled in another way than they are known: accepted, or the nearest suggested."""

from __future__ import annotations

from collections.abc import Iterable

BRITISH_AND_AMERICAN = (("centre", "center"), ("disc", "disk"))
"""Spellings of one word, in choices and in names: either is as good."""

_ALIKE = 0.75
"""From this ratio on words with different first letters are alike: nflate and inflate."""


def _plain(word: str) -> str:
    plain = word.lower().replace("_", "-")
    for british, american in BRITISH_AND_AMERICAN:
        plain = plain.replace(british, american)
    return plain


def as_known(word: str, known: Iterable[str]) -> str:
    """Return the known word that `word` is another spelling of; `word` itself if there is none."""
    names = list(known)
    if word in names:
        return word
    return next((name for name in names if _plain(name) == _plain(word)), word)


def nearest(word: str, known: Iterable[str]) -> str | None:
    """Return the known word that `word` is most like, or alone begins with it; None if none is.

    What begins with another letter must be more alike.
    """
    import difflib  # of use to mistakes alone

    plain, asked = {_plain(name): name for name in reversed(list(known))}, _plain(word)
    for near in difflib.get_close_matches(asked, plain):
        if near[0] == asked[0] or difflib.SequenceMatcher(None, near, asked).ratio() >= _ALIKE:
            return plain[near]
    begun = [name for near, name in plain.items() if len(asked) > 2 and near.startswith(asked)]
    return begun[0] if len(begun) == 1 else None


def meant(word: str, known: Iterable[str]) -> str | None:
    """Return the hint that asks for the nearest known word, if there is one."""
    near = nearest(word, known)
    return None if near is None else f"did you mean {near}?"
