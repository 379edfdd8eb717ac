"""Endings and first bytes of maps, and of what stands where a map should."""

import re

YAML, BIT_MAP = (".yaml", ".yml"), ".pbm"
MAPS = (*YAML, ".npz")
"""The likeliest first; a bit map is an image that stands for its YAML."""

NAMED_MAPS = (*MAPS, BIT_MAP)
LFS_POINTER = b"version https://git-lfs"

# Most maps need no parser: keys at the top of a mapping stand at the beginning of a line.
IMAGE_KEY = re.compile(rb"""(?m)^(\xef\xbb\xbf)?["']?image["']?[ \t]*:""")
