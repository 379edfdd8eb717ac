"""Commands as processes whose memory is measured.

The peak of a process begins with that of its parent: the one between is small.
"""

import subprocess
import sys

_PROGRAM = """
import os, subprocess, sys
process = subprocess.Popen([sys.executable, "-m", "mapdeal", *sys.argv[1:]])
_, status, usage = os.wait4(process.pid, 0)
print(usage.ru_maxrss)
sys.exit(os.waitstatus_to_exitcode(status))
"""


def measured(folder, *words):
    """Return the exit code, output and peak bytes of a command in a folder."""
    command = [sys.executable, "-c", _PROGRAM, *map(str, words)]
    completed = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    *out, peak = completed.stdout.splitlines()
    return completed.returncode, "\n".join(out) + completed.stderr, int(peak) * 1024
