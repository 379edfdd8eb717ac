"""What tests have workers do; in a module of its own, since workers import it by its name."""

import os
import signal
import time

from mapdeal.errors import FileAccessError, ParameterError, emit_warning
from mapdeal.pipeline.run import RunReport


def do(job):
    """Do what the job's name says."""
    name = job.path.stem
    if name.startswith("killer"):
        os.kill(os.getpid(), signal.SIGKILL)
    if name.startswith("once"):
        job.folder.mkdir(parents=True, exist_ok=True)
        if not list(job.folder.iterdir()):
            (job.folder / "half").write_text("of an attempt that was killed")
            os.kill(os.getpid(), signal.SIGKILL)
        assert job.is_new  # so that the rest of the first attempt can be replaced
    if name.startswith("term"):
        os.kill(os.getpid(), signal.SIGTERM)
    if name.startswith("bad"):
        raise FileAccessError("is bad", source=job.path, place="key", got=[1], hint="mend it")
    if name.startswith("bug"):
        raise RuntimeError("a bug")
    if name.startswith("memory"):
        raise MemoryError
    if name.startswith("odd"):
        return RunReport(job.folder, "done", {"f": lambda: None}, job.path)  # cannot be sent back
    if name.startswith("warn"):
        emit_warning(f"{job.path}: beware\nof this")
    if name.startswith("slow"):
        time.sleep(0.4)
    if name.startswith("two"):
        raise ParameterError("is not allowed", place="p", got=float("inf"))
    return RunReport(job.folder, "done", {"map": {"width": 3, "height": 2, "pid": 0}}, job.path)
