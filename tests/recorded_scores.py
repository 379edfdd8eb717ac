"""Scores that other libraries have found, and a comparison with them value by value."""

import json
import math

PAIRS = ("tmcl-gmap-faro", "tmcl-gmap-faro-asis", "tmcl-youbot-faro", "conestogo-any")
_RATIO, _DISTANCE, _SIMILARITY = 1e-12, 1e-9, 1e-6


def recorded_pairs(folder):
    """Return the recorded pairs by their names, given the folder of real maps."""
    document = json.loads((folder / "expected" / "score.json").read_text())
    return {pair["id"]: pair for pair in document["pairs"]}


def flat(values, before=""):
    """Return nested values by dotted names."""
    found = {}
    for name, value in values.items():
        if isinstance(value, dict):
            found |= flat(value, f"{before}{name}.")
        else:
            found[f"{before}{name}"] = value
    return found


def agreement(values, recorded):
    """Return for each recorded value, by its dotted name, whether the found one agrees."""
    found = flat(values)
    return {name: name in found and _agrees(name, found[name], value)
            for name, value in flat(recorded).items()}  # fmt: skip


def _agrees(name, found, value):
    if isinstance(value, list | int):
        return found == value
    if name.startswith("ssim"):
        return math.isclose(found, value, rel_tol=0, abs_tol=_SIMILARITY)
    if "_m." in name and "share" not in name:
        return math.isclose(found, value, rel_tol=_DISTANCE, abs_tol=0)
    return math.isclose(found, value, rel_tol=0, abs_tol=_RATIO)
