"""Work that the names of logs say, for workers that load little else."""

import os
import signal
import time
from pathlib import Path

import msgspec

from vsalog.batch.records import Answer, Record, Task


def load_nothing():
    """Prepare a worker that needs nothing."""


def do_by_name(task):
    """Do what the name of a log says, and answer when and where that was."""
    task, began = msgspec.json.decode(task, type=Task), time.time()
    path = Path(os.fsdecode(task.log.where))
    if "deadly" in task.log.name:
        with path.open("a") as file:
            file.write("x")
        os.kill(os.getpid(), signal.SIGKILL)
    if "unlucky" in task.log.name and not path.exists():
        path.touch()
        os._exit(3)
    time.sleep(60.0 if "endless" in task.log.name else 0.15)
    record = Record(
        log=task.log.name, do="estimate", status="done", vsalog="", reason=f"{began} {time.time()} {os.getpid()}"
    )
    held = 10**9 if "leaky" in task.log.name else 0
    return msgspec.json.encode(Answer(record=record, written=True, resident=held))
