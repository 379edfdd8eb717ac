"""What Python takes of memory."""

import tracemalloc
from contextlib import contextmanager


@contextmanager
def memory_below(count):
    """Hold what is done to fewer bytes at its peak."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < count
    finally:
        tracemalloc.stop()
