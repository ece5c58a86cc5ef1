"""Trajectories that are sent ahead to the loop, piece by piece."""

import queue
import secrets
import threading
import time
from typing import Callable, NamedTuple, Optional, Protocol, Sequence, Tuple

from .layout import (
    MAX_POINTS,
    CommanderStatus,
    Mode,
    PieceRefusal,
    Reference,
    TrajectoryPiece,
)

#: Time for which a robot that has arrived at a target is led there, s.
SETTLING_S = 0.3
#: Interval of the references that renew the lease while a trajectory is followed, s.
BEAT_S = 0.004
#: Greatest length of a piece of a trajectory, and how far ahead pieces are sent, ns and points.
PIECE_NS, AHEAD_NS, AHEAD_POINTS = 200_000_000, 600_000_000, 90
#: Interval at which a program is shown its progress on a trajectory, s.
SHOWN_S = 0.01


class TrajectoryError(RuntimeError):
    """A trajectory was refused, or ended in motion; the robot is brought to rest."""


class Commanding(Protocol):
    """What following a trajectory needs of a commander."""

    reference: Reference

    @property
    def status(self) -> CommanderStatus: ...

    def send(self) -> None: ...

    def send_piece(self, piece: TrajectoryPiece) -> None: ...


class Progress(NamedTuple):
    """Place on a trajectory."""

    #: Time since its begin, s.
    time_s: float
    #: Time for which the robot can go on with what has been sent, s.
    buffered_s: float


def follow(
    commander: Commanding,
    duration_s: float,
    at: Callable[[float], Sequence[Tuple[float, float, float]]],
    spacing_s: float,
    going: Optional[Callable[[Progress], bool]],
    mode: Mode,
) -> bool:
    """Follows a trajectory, as `Commander.follow` says."""
    last = max(1, -int(-duration_s // spacing_s))
    spacing = max(1, int(1e9 * duration_s / last))
    ahead = min(AHEAD_NS, AHEAD_POINTS * spacing)
    count = min(max(1, PIECE_NS // spacing), MAX_POINTS - 1)
    beat = _Heartbeat(commander, last * spacing, mode)
    beat.start()
    sent = 0
    try:
        while beat.is_alive():
            while sent < last and sent * spacing - beat.time_ns < ahead:
                end = min(sent + count, last)
                piece = TrajectoryPiece(
                    trajectory=beat.trajectory,
                    begins_ns=sent * spacing,
                    spacing_ns=spacing,
                    joint_count=commander.reference.joint_count,
                    point_count=end - sent + 1,
                )
                for k, point in zip(range(sent, end + 1), piece.points):
                    for joint, desired in zip(point.joints, at(1e-9 * k * spacing)):
                        joint.q_d, joint.dq_d, joint.ddq_d = desired
                sent = end
                beat.pieces.put((piece, sent == last))
            progress = Progress(1e-9 * beat.time_ns, 1e-9 * (sent * spacing - beat.time_ns))
            if going is not None and not going(progress):
                break
            time.sleep(SHOWN_S)
    finally:
        beat.stop.set()
        beat.join()
    if beat.error is not None:
        raise beat.error
    return beat.is_there


class _Heartbeat(threading.Thread):
    """Renews the lease and sends pieces as they come, until the end of the trajectory."""

    def __init__(self, commander: Commanding, end_ns: int, mode: Mode):
        super().__init__(name="heartbeat", daemon=True)
        self._commander, self._end_ns, self._mode = commander, end_ns, mode
        self.trajectory = secrets.randbits(64) or 1
        #: Pieces to be sent, each with whether it is the last.
        self.pieces: "queue.SimpleQueue[Tuple[TrajectoryPiece, bool]]" = queue.SimpleQueue()
        self.stop = threading.Event()
        self.time_ns = 0
        self.is_there = False
        self.error: Optional[Exception] = None

    def run(self) -> None:
        try:
            self._send()
        except Exception as error:
            self.error = error

    def _send(self) -> None:
        commander, reference = self._commander, self._commander.reference
        before = commander.status.commander
        first, arrived, complete = None, None, False
        while True:
            try:
                piece, complete = self.pieces.get(timeout=BEAT_S)
                commander.send_piece(piece)
                first = first or piece.sequence
                reference.mode, reference.trajectory = self._mode, self.trajectory
                newest = piece
            except queue.Empty:
                pass
            if self.stop.is_set():
                return self._hold()
            commander.send()
            lease = commander.status.commander
            if lease.session != reference.session or first is None:
                continue
            if lease.pieces_refused != before.pieces_refused and lease.refused_piece >= first:
                self._hold()
                reason = PieceRefusal(lease.piece_refusal)
                raise TrajectoryError(f"a piece of the trajectory was refused: {reason.name}")
            if lease.trajectory != self.trajectory:
                continue
            if lease.trajectories_ended != before.trajectories_ended:
                raise TrajectoryError(
                    "the trajectory ended in motion: velocity or acceleration of its last point was not "
                    "0, or the next points had not come in time; the robot was brought to rest"
                )
            self.time_ns = int(1e9 * lease.trajectory_s)
            if self.time_ns < self._end_ns or not complete:
                continue
            arrived = arrived or time.monotonic()
            if time.monotonic() > arrived + SETTLING_S:
                # The program may go on from here, by references of its own.
                reference.trajectory = 0
                for joint, last in zip(
                    reference.joints, newest.points[newest.point_count - 1].joints
                ):
                    joint.q_d, joint.dq_d, joint.ddq_d = last.q_d, 0.0, 0.0
                commander.send()
                self.is_there = True
                return

    def _hold(self) -> None:
        reference = self._commander.reference
        reference.mode, reference.trajectory = Mode.HOLD, 0
        self._commander.send()
