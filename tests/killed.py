"""Run code and kill it, without any chance to clean up, where it does the N-th thing to files in the working
folder: `python killed.py N CODE ARGUMENT …`. With N = 0 it runs to its end.

With a folder in place of N it runs to its end, too, and before each such thing copies what is visible in the
working folder to `FOLDER/1`, `FOLDER/2`, …: what would be there had it been killed at that moment. A single
run shows all of them.
"""

import os
import shutil
import signal
import sys
import threading
from pathlib import Path

WHEN = sys.argv[1]
HERE = Path.cwd()
WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT
done = 0
looking = threading.RLock()


def changes(event: str, arguments: tuple) -> bool:
    """Whether an audit event of Python, which comes before the thing itself, changes files of the folder."""
    if event == "open":
        writes = isinstance(arguments[2], int) and bool(arguments[2] & WRITING)
    else:
        writes = event in ("os.rename", "os.remove", "os.mkdir", "os.rmdir", "os.chmod")
    return writes and str(arguments[0]).startswith(str(HERE))


def kill(event, arguments):
    """Die at the N-th of them."""
    global done
    if changes(event, arguments):
        done += 1
        if done == int(WHEN):
            os.kill(os.getpid(), signal.SIGKILL)


def copy(event, arguments):
    """Keep what is visible at each of them; other threads that change files wait meanwhile."""
    global done
    if changes(event, arguments):
        with looking:
            done += 1
            into = Path(WHEN, str(done))
            into.mkdir()
            for path in HERE.iterdir():
                if not path.name.startswith("."):
                    copied = shutil.copytree if path.is_dir() else shutil.copyfile
                    copied(path, into / path.name)


if __name__ == "__main__":
    if WHEN != "0":
        sys.addaudithook(kill if WHEN.isdigit() else copy)
    code = sys.argv[2]
    sys.argv[:] = ["jaxmuscle", *sys.argv[3:]]
    exec(compile(code, "code", "exec"))
