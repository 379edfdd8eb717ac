"""Where the project asks the system about names, and why each of its walks ends."""

import ast

import pytest

from sources import MODULES, place_of, tree_of

pytestmark = pytest.mark.slow

WALKS = {
    "files/source.py:contents_of": "lists one folder, each entry once",
    "checks/map_checks.py:lint_run": "lists one folder",
    "inputs/listing.py:_files_of": "one folder, or the pattern's files, each once",
    "inputs/listing.py:files_matching": "each part of a pattern takes each real folder once",
    "inputs/listing.py:_one_part_on": "the folders of one part: real ones, each once",
    "inputs/listing.py:_seen_in": "lists one folder",
    "inputs/listing.py:numbered_folders": "lists one folder",
    "commands/lint.py:_images_of": "lists one folder",
    "inputs/listing.py:_below_folder": "each real folder once, however many links lead to it",
    "inputs/listing.py:look_into": "lists one folder",
    "maps/map_server.py:_nearest_name": "lists one folder",
    "files/source.py:file_meant": "lists one folder",
    "bags/reader.py:_guessed": "lists one folder",
    "bags/reader.py:_present": "lists one folder",
    "bags/bag.py:bag_paths": "lists one folder",
    "inputs/kinds.py:_kind_of_folder": "lists one folder",
    "files/transaction.py:remove_stale": "lists one folder",
    "files/transaction.py:_make": "a path gets shorter with each step, up to the root",
    "commands/report_entries.py:runs_in": "by `folders_below`, into each real folder once",
    "files/source.py:free_memory": "a path gets shorter with each step, up to its end",
}
"""Each function that lists a folder or climbs up a path, and why it is linear in what is there.

A walk that is not here is a new one: say of it why it ends, with links in a circle, too.
"""

LISTING = {
    "glob", "iglob", "rglob", "iterdir", "fwalk", "scandir", "listdir",
    "contents_of", "files_matching", "folders_below",
}  # fmt: skip


def called(node):
    """Return the name of what a node calls, with its object where that is a name."""
    if not isinstance(node, ast.Call):
        return ""
    if isinstance(node.func, ast.Attribute):
        owner = node.func.value
        return f"{owner.id if isinstance(owner, ast.Name) else '?'}.{node.func.attr}"
    return node.func.id if isinstance(node.func, ast.Name) else ""


def is_walk(node):
    climbs = isinstance(node, ast.While) and any(
        isinstance(one, ast.Assign) and getattr(one.value, "attr", "") == "parent"
        for one in ast.walk(node)
    )
    return climbs or called(node).rpartition(".")[2] in LISTING or called(node) == "os.walk"


def test_every_walk_is_known_to_end():
    found = {
        f"{place_of(path)}:{function.name}"
        for path in MODULES
        for function in ast.walk(tree_of(path))
        if isinstance(function, ast.FunctionDef) and any(map(is_walk, ast.walk(function)))
    }
    assert found == set(WALKS)


ALLOWED = {
    "files/source.py": "the place where the system is asked",
    "files/transaction.py": "tells troubles of outputs from those of inputs; its own files",
}
"""Modules that ask the system about names by themselves."""

OF_PATHS = {
    "absolute", "cwd", "exists", "expanduser", "is_dir", "is_file", "is_mount", "is_symlink",
    "iterdir", "lstat", "readlink", "resolve", "rglob", "samefile", "stat",
}  # fmt: skip
OF_OS = {
    "access", "getcwd", "listdir", "lstat", "readlink", "scandir", "stat", "walk",
    "abspath", "exists", "getsize", "getmtime", "isdir", "isfile", "islink", "realpath",
    "samefile",
}  # fmt: skip


def test_the_system_is_asked_about_names_in_one_place():
    """What it raises depends on the name, on who asks, and on the version of Python."""
    raw = set()
    for path in MODULES:
        module = place_of(path)
        for node in ast.walk(tree_of(path)):
            owner, _, method = called(node).rpartition(".")
            is_of_os = owner != "" and ast.unparse(node.func).startswith(("os.", "path."))
            if owner and method in (OF_OS if is_of_os else OF_PATHS):
                raw.add(f"{module}:{node.lineno}: {ast.unparse(node)}")
    assert {one for one in raw if one.partition(":")[0] not in ALLOWED} == set()
