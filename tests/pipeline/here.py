"""Workers in this process, for what befalls those of other processes."""

from concurrent.futures import Future
from contextlib import contextmanager

from mapdeal import FileAccessError


class HereWorkers:
    """Workers that can be started so often; fates are called by the stem of a job's path."""

    def __init__(self, size=1, fates=None, starts=1 << 30):
        self.size, self._fates, self._starts = size, fates or {}, starts

    @contextmanager
    def started(self, _size, work):
        if self._starts == 0:
            raise FileAccessError("cannot be started", source="worker processes")
        self._starts -= 1

        def submit(job):
            future = Future()
            try:
                future.set_result(self._fates.get(job.path.stem, lambda: work(job))())
            except Exception as error:  # noqa: BLE001 - as a pool does
                future.set_exception(error)
            return future

        yield submit


def die_of(error):

    def die():
        raise error

    return die
