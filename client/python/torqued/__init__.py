"""Joint torques of a robot that `torqued` runs, and references for it, by shared memory.

    client = torqued.Client("leg")
    for record in client.records():
        print(record.cycle.estimated.joints[0].tau_whole_body.tau)
"""

from .client import Client, NoDaemonError, OtherLayoutError, RefusedError, text
from .commander import (
    AlreadyCommandedError,
    Commander,
    CommandLostError,
    NotFollowedError,
    why_not_followed,
)
from .keep import Meanwhile
from .layout import *  # noqa: F403  the records and their enumerations
from .location import NoRoomError, RunDirectoryError, run_dir
from .trajectory import Progress, TrajectoryError
