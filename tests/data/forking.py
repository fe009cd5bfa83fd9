"""Programs of Python's started one after another, with the libraries that they need imported once.

Each line of standard input is a command of a program, its arguments and a file for what it says,
as JSON; its exit status is written for it. One that takes longer than ten seconds is ended.
"""

import json
import os
import runpy
import signal
import sys

import asammdf  # noqa: F401
import h5py  # noqa: F401
import nptdms  # noqa: F401
import scipy.io  # noqa: F401

for line in sys.stdin:
    *command, told = json.loads(line)
    child = os.fork()
    if child == 0:
        os.dup2(os.open(told, os.O_WRONLY | os.O_CREAT | os.O_TRUNC), 1)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        signal.alarm(10)
        sys.argv = command
        runpy.run_path(command[0], run_name="__main__")
        os._exit(0)  # without what the libraries do at the end, which takes longer than all else
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)
