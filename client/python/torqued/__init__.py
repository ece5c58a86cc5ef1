"""Joint torques of a robot that `torqued` runs, and references for it, by shared memory.

    client = torqued.Client("leg")
    for record in client.records():
        print(record.cycle.estimated.joints[0].tau_whole_body.tau)
"""

from .client import (
    AlreadyCommandedError,
    Client,
    Commander,
    NoDaemonError,
    OtherLayoutError,
    RefusedError,
    text,
)
from .layout import *  # noqa: F403  the records and their enumerations
from .location import NoRoomError, RunDirectoryError, run_dir
