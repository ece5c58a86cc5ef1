"""References of a commanding client."""

import enum
import os
import secrets
import threading
import time
from typing import Callable, Dict, Iterable, Optional, Sequence, Tuple

import iceoryx2 as iox2

from . import location, trajectory
from .client import POLL_S, RETRY_S, Client, NoDaemonError, newest_message
from .keep import Keeper, Meanwhile, alone, copied
from .layout import (
    EVENTS,
    MAX_FRAMES,
    CommanderStatus,
    FrameFlags,
    FrameReference,
    LeaseRefusal,
    Mode,
    NotFollowed,
    Reference,
    RobotState,
    TrajectoryPiece,
)
from .trajectory import SETTLING_S, Progress

#: Longest wait for the daemon's verdict on a new session, and longest silence of the daemon, s.
SILENCE_S = 1.0
#: Time in which a commander that has just vanished is noticed: as long, another one asks again, s.
HAND_OVER_S = 0.16
#: Interval of references that ask for hold until there is a verdict, s.
ASK_INTERVAL_S = 0.005


class AlreadyCommandedError(RuntimeError):
    """Another client commands the robot."""


class CommandLostError(RuntimeError):
    """This client no longer commands the robot."""


class NotFollowedError(RuntimeError):
    """References are not followed, though this client commands the robot."""


class _Standing(enum.Enum):
    """Standing of a commander's session with the daemon."""

    ASKING = enum.auto()
    COMMANDING = enum.auto()
    OVER = enum.auto()  # refused, or the lease was lost


class Commander:
    """The right to command a robot. One client has it at a time, by lease: each reference renews it.
    Used in a `with` block, which leaves the robot holding its position; so does the death of this
    program or its silence, once `loop.reference_timeout_ms` have passed. A commander of higher
    `priority` takes the lease over.

    References that are not followed raise an error in `send`: after a fault, an operator's stop, a
    flaw in a reference, the loss of the lease or a restart of the daemon. In all these cases a
    reference that asks for mode hold begins anew."""

    def __init__(self, client: Client, priority: int = 0):
        """Takes the command of the client's robot. References begin with mode hold and `q_d` at the
        measured pose of the newest record, which is taken from the client. Waits until the daemon
        has given the lease, also to a robot that cannot move yet; raises `AlreadyCommandedError`."""
        record = client.latest() or client.next_record()
        self._robot = client.robot
        service = client._open("commander", CommanderStatus, time.monotonic())
        self._statuses = service.subscriber_builder().create()
        service = client._open("reference", Reference, time.monotonic())
        until = time.monotonic() + RETRY_S
        while True:
            try:
                self._references = service.publisher_builder().create()
                break
            except iox2.PublisherCreateError as e:
                if time.monotonic() > until:
                    raise AlreadyCommandedError(
                        f'robot "{client.robot}": the greatest number of clients try to command '
                        "it; try again later"
                    ) from e
                # The process that holds the place may have died a moment ago.
                client._node.try_cleanup_dead_nodes()
            time.sleep(0.01)
        service = client._open("trajectory", TrajectoryPiece, time.monotonic())
        self._pieces = service.publisher_builder().create()
        self._piece_count = 0
        #: Held while the commander is used: a thread may keep the lease meanwhile.
        self._lock = threading.RLock()
        self._keeper: Optional[Keeper] = None
        location.reserve(client._run_dir)
        #: The present reference; `send` sends it.
        self.reference = Reference(
            joint_count=client.description.joint_count,
            mode=Mode.HOLD,
            priority=priority,
            pid=os.getpid(),
        )
        for desired, measured in zip(self.reference.joints, record.cycle.measured.joints):
            desired.q_d = measured.q
        self._joint_names = client.joint_names
        self._status = CommanderStatus()
        self._heard = time.monotonic()
        self._standing = _Standing.OVER
        #: Sequence of the first reference that asks for the present mode, if that is not hold.
        self._mode_from: Optional[int] = None
        try:
            self._ask()
        except Exception:
            self._delete()
            raise

    @property
    def status(self) -> CommanderStatus:
        """What the daemon reports of this moment: who commands, the robot's state, and whether and
        why no mode is followed."""
        status = newest_message(self._statuses, CommanderStatus)
        if status is not None:
            self._status, self._heard = status, time.monotonic()
        return self._status

    def send(self, change: Optional[Callable[[Reference], None]] = None) -> None:
        """Sends the reference, after `change` if given. To be called at least every
        `loop.reference_timeout_ms`: each reference renews the lease. An error is about earlier
        references: `NotFollowedError` if a mode is asked for that is not followed,
        `CommandLostError`, `AlreadyCommandedError`, `NoDaemonError`. A reference that asks for mode
        hold after the lease was lost begins a new session."""
        with self._lock:
            if self._keeper is not None:
                self._keeper.sent()
            self._send(change)

    def keep(self, busy_s: float, meanwhile: Meanwhile = Meanwhile.HOLD) -> None:
        """From now on a thread keeps the lease while this program sends nothing for up to `busy_s`, at
        most 1 s, and says meanwhile what `meanwhile` says: hold, or the newest reference carried on.
        `busy_s` of 0 ends it. References are changed in `send(change)` then, or between two calls. Python's
        own lock must not be kept for longer than `loop.reference_timeout_ms`: NumPy gives it up, a loop in a
        compiled module may not."""
        if self._keeper is not None:
            self._keeper.end()
            self._keeper = None
        if busy_s > 0.0:
            self._keeper = Keeper(self, busy_s, meanwhile)

    def _send(self, change: Optional[Callable[[Reference], None]]) -> None:
        if change is not None:
            change(self.reference)
        asks_hold = self.reference.mode == Mode.HOLD
        error = self._judge()
        if self._standing == _Standing.OVER:
            if not asks_hold or isinstance(error, AlreadyCommandedError):
                raise error
            self._begin_session()
        self._publish()
        if not asks_hold:
            self._mode_from = self._mode_from or self.reference.sequence
        else:
            self._mode_from = None
            if isinstance(error, (CommandLostError, NotFollowedError)):
                error = None  # mended by this very reference
        if error is not None:
            raise error

    @alone
    def hold_until_ready(self, timeout_s: float) -> None:
        """Asks for mode hold until a mode would be followed: for a robot that an operator is about to
        enable, or after an error of `send`. Raises `NotFollowedError` with the reason if it is not
        so in time."""
        until = time.monotonic() + timeout_s
        self.reference.mode = Mode.HOLD
        self._mode_from = None
        hold = self.reference.sequence + 1
        while True:
            self._ask()
            self._publish()
            time.sleep(ASK_INTERVAL_S)
            lease = self.status.commander
            own = lease.session == self.reference.session
            if own and lease.sequence >= hold and not lease.not_followed:
                return
            if time.monotonic() > until:
                raise self._not_followed()

    @alone
    def go_to(
        self,
        targets: Dict[str, float],
        speed: Optional[float] = None,
        going: Optional[Callable[[float], bool]] = None,
    ) -> bool:
        """Sends joints to positions, rad or m, by mode position, and waits until the robot is there and stays
        there; joints that are not named keep their targets. `speed`: greatest speed of every joint,
        rad/s or m/s; the configured ones if none is given. `going` is shown the time in s that the motion
        will still take and says whether it is to go on; if not, the robot is brought to rest. True if
        it has arrived. Raises as `send`, and `KeyError` for a joint that the robot does not have."""
        self._check_joints(targets)
        self.reference.trajectory = 0
        for name, joint in zip(self._joint_names, self.reference.joints):
            joint.q_d = targets.get(name, joint.q_d)
            joint.dq_d = speed or 0.0
        self.reference.mode = Mode.POSITION
        first = self.reference.sequence + 1
        arrived = None
        while True:
            self.send()
            time.sleep(ASK_INTERVAL_S)
            status = self.status
            lease = status.commander
            own = lease.session == self.reference.session and lease.sequence >= first
            if not own or status.mode != Mode.POSITION:
                continue
            if lease.motion_left_s <= 0.0:
                arrived = arrived or time.monotonic()
                if time.monotonic() > arrived + SETTLING_S:
                    return True
            if going is not None and not going(lease.motion_left_s):
                self.reference.mode = Mode.HOLD
                self.send()
                return False

    @alone
    def lead_frames(self, client: Client, names: Sequence[str]) -> Dict[str, FrameReference]:
        """Prepares mode Cartesian with these frames: the robot holds until their poses are shown, and
        the reference asks for these poses and for the joints' angles, without stiffness or force, and
        damping ratio 1. Returns their references, to be changed in place before each `send`; go on by
        setting stiffness or force in them, and `reference.mode = Mode.CARTESIAN`. `client`: of the same
        robot; its records are taken. Raises as `send`, and `KeyError` for a frame that the robot does
        not have."""
        unknown = set(names) - set(client.frame_names)
        if unknown:
            raise KeyError(
                f"{', '.join(sorted(unknown))}: not a frame of robot "
                f'"{self._robot}", which has {", ".join(client.frame_names) or "none"}'
            )
        for index in range(MAX_FRAMES):
            self.reference.frames[index] = FrameReference(
                orientation=(1.0, 0.0, 0.0, 0.0), damping_ratio=1.0
            )
        used = {name: self.reference.frames[client.frame_names.index(name)] for name in names}
        for frame in used.values():
            frame.used = 1
        self.reference.mode = Mode.HOLD
        until = time.monotonic() + SILENCE_S
        while True:
            self.send()
            time.sleep(ASK_INTERVAL_S)
            record = client.latest()
            if record is not None:
                shown = {
                    name: record.cycle.commanded.frames[client.frame_names.index(name)]
                    for name in names
                }
                if all(frame.flags & FrameFlags.VALID for frame in shown.values()):
                    break
            if time.monotonic() > until:
                raise self._silent()
        for name, frame in used.items():
            frame.position[:] = shown[name].position[:]
            frame.orientation[:] = shown[name].orientation[:]
        for desired, measured in zip(self.reference.joints, record.cycle.measured.joints):
            desired.q_d, desired.dq_d, desired.ddq_d = measured.q, 0.0, 0.0
        self.reference.gains_given = self.reference.trajectory = 0
        return used

    def let_go(self, names: Sequence[str]) -> None:
        """Lets joints go, by mode passive: a hand can move them, the others are held at `q_d` of the
        reference, as they stood when this commander began. To be called as `send`, and raises as it;
        `KeyError` for a joint that the robot does not have."""
        self._check_joints(names)
        held = (1 << 64) - 1
        for name in names:
            held &= ~(1 << self._joint_names.index(name))
        self.reference.mode, self.reference.held_joints = Mode.PASSIVE, held
        self.reference.trajectory = 0
        for joint in self.reference.joints:
            joint.dq_d = joint.ddq_d = 0.0
        self.send()

    def stand(self, front_m: float = 0.0, left_m: float = 0.0) -> None:
        """Lets the robot stand on its feet, by mode stand, in the pose of the reference: its centre of
        mass so far from the middle of the soles. To be called as `send`, and raises as it."""
        self.reference.mode, self.reference.trajectory = Mode.STAND, 0
        self.reference.center_of_mass_offset[:] = front_m, left_m
        self.reference.lifted_feet = 0
        for joint in self.reference.joints:
            joint.dq_d = joint.ddq_d = 0.0
        self.send()

    def follow(
        self,
        duration_s: float,
        at: Callable[[float], Sequence[Tuple[float, float, float]]],
        spacing_s: float = 0.005,
        going: Optional[Callable[[Progress], bool]] = None,
        mode: Mode = Mode.INVERSE_DYNAMICS,
    ) -> bool:
        """Follows a trajectory by mode inverse dynamics, or torque-feedback motion or low-gain
        tracking, from the robot's present pose on, and waits
        until it has ended: the program may go on with any mode. `at` gives position, velocity and
        acceleration of every joint, in config order, at a time since the begin; it is asked every
        `spacing_s`, and the loop interpolates. It should begin at the present pose and end at rest,
        with velocities and accelerations of 0.
        `going` is shown the progress and says whether it is to go on; if not, the robot is brought
        to rest. True if the end was reached.

        While this runs, a thread of its own renews the lease, and half a second of the trajectory is
        buffered: `at` and `going` may take a tenth of a second now and then, but must not keep
        Python's lock for longer than `loop.reference_timeout_ms`.

        Raises as `send`, and `TrajectoryError` where points are beyond limits, the last one is in
        motion or `at` took too long."""
        return trajectory.follow(self, duration_s, at, spacing_s, going, mode)

    def send_piece(self, piece: TrajectoryPiece) -> None:
        """Sends a piece of a trajectory of this session, as `follow` does; its sequence is set."""
        self._piece_count += 1
        piece.session, piece.sequence = self.reference.session, self._piece_count
        self._pieces.loan_uninit().write_payload(piece).send()

    def close(self) -> None:
        """Gives the lease back: the robot holds, and another client may command at once."""
        self.keep(0.0)
        over, self._standing = self._standing == _Standing.OVER, _Standing.OVER
        try:
            if not over:
                self.reference.mode = Mode.HOLD
                self.reference.gives_back = 1
                self._publish()
        finally:
            self._delete()

    def __enter__(self) -> "Commander":
        return self

    def __exit__(self, *_) -> None:
        try:
            self.close()
        except NoDaemonError:
            pass

    def _delete(self) -> None:
        for port in (self._references, self._pieces, self._statuses):
            if port is not None:
                port.delete()
        self._references = self._pieces = self._statuses = None

    def _check_joints(self, names: Iterable[str]) -> None:
        unknown = set(names) - set(self._joint_names)
        if unknown:
            raise KeyError(
                f"{', '.join(sorted(unknown))}: not a joint of robot "
                f'"{self._robot}", which has {", ".join(self._joint_names)}'
            )

    def _ask(self) -> None:
        """Has the lease, or asks for it until there is a verdict."""
        since = time.monotonic()
        asked = None
        while True:
            error = self._judge()
            held = isinstance(error, AlreadyCommandedError)
            if self._standing == _Standing.COMMANDING or (
                self._standing == _Standing.ASKING and error is not None
            ):
                if error is not None:
                    raise error
                return
            now = time.monotonic()
            if self._standing == _Standing.OVER and asked is not None:
                if now > since + (HAND_OVER_S if held else SILENCE_S):
                    raise error
            if asked is None or now > asked + (HAND_OVER_S / 8 if held else ASK_INTERVAL_S):
                if self._standing == _Standing.OVER:
                    self._begin_session()
                self._publish()
                asked = now
            time.sleep(POLL_S)

    def _begin_session(self) -> None:
        self.reference.session = secrets.randbits(64) or 1
        self.reference.session_began_ns = time.monotonic_ns()
        self._standing = _Standing.ASKING
        self._heard = time.monotonic()
        self._mode_from = None

    def _judge(self) -> Optional[Exception]:
        """What the newest status means for this session and its references."""
        lease = self.status.commander
        own = self.reference.session
        if own and lease.session == own:
            self._standing = _Standing.COMMANDING
        elif self._standing != _Standing.ASKING:
            self._standing = _Standing.OVER
            return self._lost()
        elif lease.refused_session == own:
            self._standing = _Standing.OVER
            held = lease.refused_reason == LeaseRefusal.HELD
            return self._already_commanded() if held else self._lost()
        elif time.monotonic_ns() - self.reference.session_began_ns > SILENCE_S * 1e9:
            return self._already_commanded() if lease.session else self._silent()
        if time.monotonic() > self._heard + SILENCE_S:
            return self._silent()
        counts = self._mode_from is not None and lease.sequence >= self._mode_from
        # Filters and sensors that are not ready are so for a moment only, or an event follows.
        waits = lease.not_followed in (0, NotFollowed.NOT_READY) or (
            lease.not_followed == NotFollowed.NOT_POSSIBLE and lease.cause == 0
        )
        if counts and self._standing == _Standing.COMMANDING and not waits:
            return self._not_followed()
        return None

    def _renew(self, change: Callable[[Reference], None]) -> None:
        """Renews the lease by the newest reference, changed for this once; for the thread that keeps it."""
        self._judge()
        if self._standing != _Standing.COMMANDING or self._references is None:
            return
        # The program may read its own reference at any time, so that what is sent is another one.
        sent = copied(self.reference)
        change(sent)
        if sent.mode != self.reference.mode:
            self._mode_from = None  # the program's mode begins anew with its next reference
        try:
            self._publish(sent)
        except NoDaemonError:
            pass  # an error of the program's next call
        finally:
            self.reference.sequence, self.reference.sent_ns = sent.sequence, sent.sent_ns

    def _publish(self, reference: Reference | None = None) -> None:
        reference = self.reference if reference is None else reference
        if self._references is None:
            raise CommandLostError(f'robot "{self._robot}": this commander was closed')
        with self._lock:
            reference.sequence += 1
            reference.sent_ns = time.monotonic_ns()
            sample = self._references.loan_uninit().write_payload(reference)
            listeners = sample.send()
        if listeners == 0:
            raise NoDaemonError("references have no receiver; torqued has stopped or was killed")

    def _already_commanded(self) -> Exception:
        lease = self._status.commander
        held_s = (time.monotonic_ns() - lease.since_ns) * 1e-9
        return AlreadyCommandedError(
            f'robot "{self._robot}" is commanded by another client: process {lease.pid} (session '
            f"{lease.session:016x}, priority {lease.priority}), for {held_s:.1f} s; one at a time "
            "may command: stop that one first, or ask with a higher priority"
        )

    def _lost(self) -> Exception:
        lease = self._status.commander
        if lease.session and lease.priority >= self.reference.priority:
            return self._already_commanded()
        return CommandLostError(
            f'robot "{self._robot}": the command was lost: no reference came for longer than '
            "loop.reference_timeout_ms, or the daemon was started again; ask for mode hold to get "
            "it again"
        )

    def _silent(self) -> Exception:
        return NoDaemonError(
            f'robot "{self._robot}": the daemon was silent for {SILENCE_S} s; torqued has stopped '
            "or was killed: look at its log and start it again"
        )

    def _not_followed(self) -> Exception:
        return NotFollowedError(
            f'robot "{self._robot}": references are not followed: {why_not_followed(self._status)}'
        )


def why_not_followed(status: CommanderStatus) -> str:
    """Why no mode of the commander is followed, and the next step."""
    reason, cause = status.commander.not_followed, status.commander.cause
    event = next((event for event in EVENTS if event.number == cause), None)
    named = f"{event.number} {event.name} ({event.cause})" if event else ""
    state = RobotState(status.state).name.lower()
    if reason == NotFollowed.FAULT:
        return (
            f"fault {named} is latched; mend its cause, then `torquectl acknowledge` and "
            "`torquectl enable`"
        )
    if reason == NotFollowed.STATE:
        return f"the robot is in state {state}, not in holding; `torquectl state` has the next step"
    if reason == NotFollowed.HOLD_FIRST:
        after = named or "an operator's request"
        return f"the robot holds after {after}; ask for mode hold first"
    if reason == NotFollowed.NOT_READY:
        return "the joints' filters are not full yet"
    if reason == NotFollowed.NOT_POSSIBLE and event:
        return f"the mode needs a source that {named} speaks against"
    if reason == NotFollowed.NOT_POSSIBLE:
        return "the mode needs F/T sensors or the IMU, which are not ready"
    return f"the robot is in state {state}"
