"""How much memory a process ever had."""

import resource
import sys
from pathlib import Path

MILLION = 10**6


def largest() -> float:
    """MB of this process. Not from ru_maxrss on Linux: there it begins at the size of the parent."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
        return int(status.partition("VmHWM:")[2].split()[0]) * 1024 / MILLION
    except (OSError, ValueError, IndexError):
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit / MILLION
