import tracemalloc
from contextlib import contextmanager


@contextmanager
def memory_below(count):
    """Check that the peak of memory in a block is below a number of bytes."""
    tracemalloc.start()
    try:
        yield
        assert tracemalloc.get_traced_memory()[1] < count
    finally:
        tracemalloc.stop()
