"""Records and requests of a client."""

import asyncio
import ctypes
import secrets
import time
from pathlib import Path
from typing import AsyncIterator, Callable, Iterator, Optional

import iceoryx2 as iox2

from . import location
from .layout import (
    Answer,
    AnswerStatus,
    Description,
    JointKind,
    Request,
    RequestKind,
    SharedRecord,
)

#: Interval between polls of shared memory, s.
POLL_S = 0.5e-3
#: Longest time without an answer, s; the daemon sends ten a second while it works on a request.
ANSWER_TIMEOUT_S = 2.0
#: Time limit of retries while dead processes are being cleaned up, s.
RETRY_S = 0.5

# Errors are raised; the transport shall not print them as well.
iox2.set_log_level_from_env_or(iox2.LogLevel.Fatal)


class NoDaemonError(RuntimeError):
    """No daemon runs for that robot, or it has ended."""


class OtherLayoutError(RuntimeError):
    """Daemon and client were built with different records."""


class RefusedError(RuntimeError):
    """The daemon has refused a request, and nothing has changed."""


class Client:
    """A connection to a robot's daemon. It outlives the daemon: when a new one takes over, its
    records follow."""

    def __init__(self, robot: str, timeout_s: float = 2.0, run_dir: Optional[Path] = None):
        """Connects to the daemon that runs `robot`, waiting for it at most `timeout_s`."""
        self.robot = robot
        #: Records lost so far because this program was too slow (128 are kept for it).
        self.lost = 0
        self._run_dir = Path(run_dir or location.run_dir())
        self._newest_sequence: Optional[int] = None
        self._node = (
            iox2.NodeBuilder.new()
            .config(location.config(self._run_dir))
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
            .create(iox2.ServiceType.Ipc)
        )
        until = time.monotonic() + timeout_s
        service = self._open("description", Description, until)
        self._descriptions = service.subscriber_builder().create()
        while (description := newest_message(self._descriptions, Description)) is None:
            if time.monotonic() > until:
                raise self._no_daemon("description")
            time.sleep(POLL_S)
        #: Names and constants of the robot.
        self.description = description
        self._records = self._open("state", SharedRecord, until).subscriber_builder().create()
        location.reserve(self._run_dir)

    @property
    def joint_names(self) -> list[str]:
        """The joints' names, in config order."""
        names = self.description.joint_names[: self.description.joint_count]
        return [text(name) for name in names]

    @property
    def frame_names(self) -> list[str]:
        """Names of the frames of mode Cartesian, in the order of every record's `frames`."""
        names = self.description.frame_names[: self.description.frame_count]
        return [text(name) for name in names]

    @property
    def joint_kinds(self) -> list[JointKind]:
        """The joints' kinds: of a prismatic one every link-side quantity is in m and N, not in rad and N·m."""
        kinds = self.description.joint_kinds[: self.description.joint_count]
        return [JointKind(kind) for kind in kinds]

    @property
    def ft_names(self) -> list[str]:
        """The F/T sensors' names, in config order."""
        return [text(name) for name in self.description.ft_names[: self.description.ft_count]]

    @property
    def contact_set_names(self) -> list[str]:
        """The names of the sets of contacts; the first holds at the start."""
        count = self.description.contact_set_count
        return [text(name) for name in self.description.contact_set_names[:count]]

    def tare(self, contact_set: str) -> Answer:
        """Tares the F/T sensors of a robot at rest in mode hold, touched by the contacts of the
        contact set of that name. Waits until it is done; the answer has the new offsets and those
        before. Raises `RefusedError` with the reason."""
        return self.request(RequestKind.TARE, contact_set)

    def tare_joint(self, joint: str, torque: float, sigma: float) -> Answer:
        """Tares one joint of a robot that holds: it is known to carry `torque`, N·m, with the standard
        deviation `sigma`. Its calibrated torsion and motor current get their zeros from that, until
        the daemon ends. Raises `RefusedError` with the reason."""
        index = self.joint_names.index(joint)
        return self.request(RequestKind.TARE_JOINT, joint=index, torque=torque, sigma=sigma)

    def last_tare(self) -> Answer:
        """The offsets in use, and when and with which contacts they were found."""
        return self.request(RequestKind.SHOW_TARE)

    def forget_tare(self) -> Answer:
        """Discards the offsets of all tares; those of the configuration are used again."""
        return self.request(RequestKind.FORGET_TARE)

    def choose_contact_set(self, name: str) -> Answer:
        """Uses that contact set from now on, one of `contact_set_names`."""
        return self.request(RequestKind.CHOOSE_CONTACT_SET, name)

    def automatic_contact_set(self) -> Answer:
        """Lets the automatic rule choose the contact set from now on."""
        return self.request(RequestKind.AUTOMATIC_CONTACT_SET)

    def enable(self) -> Answer:
        """Switches the drives on and waits until every joint is held where it stands. A client that
        commands is followed once it has asked for hold. Raises `RefusedError` with the reason; the
        records' `state` shows the result, a `RobotState`."""
        return self.request(RequestKind.ENABLE)

    def disable(self) -> Answer:
        """Ends all set-points and switches the drives off; waits until it is so."""
        return self.request(RequestKind.DISABLE)

    def stop(self) -> Answer:
        """Brings the robot to rest and waits until it holds. Whoever commands it must ask for hold
        before it is followed again."""
        return self.request(RequestKind.STOP)

    def acknowledge(self, fault: int) -> Answer:
        """Acknowledges the latched fault of that number, that of a record's `cycle.fault`."""
        return self.request(RequestKind.ACKNOWLEDGE, fault=fault)

    def request(
        self,
        kind: RequestKind,
        contact_set: str = "",
        progress: Optional[Callable[[Answer], None]] = None,
        fault: int = 0,
        joint: int = 0,
        torque: float = 0.0,
        sigma: float = 0.0,
    ) -> Answer:
        """Sends a request and waits for its last answer; `progress` sees those before it. Several
        clients may ask at once."""
        # The answers' receiver is opened first, so that none is missed.
        answers = self._open("answer", Answer, time.monotonic()).subscriber_builder().create()
        requests = self._open("request", Request, time.monotonic()).publisher_builder().create()
        location.reserve(self._run_dir)
        try:
            asked = Request(
                id=secrets.randbits(64),
                kind=kind,
                fault=fault,
                joint=joint,
                torque=torque,
                sigma=sigma,
            )
            name = contact_set.encode()[: ctypes.sizeof(asked.contact_set)]
            ctypes.memmove(asked.contact_set, name, len(name))
            if requests.loan_uninit().write_payload(asked).send() == 0:
                raise NoDaemonError("requests have no receiver; torqued has stopped or was killed")
            return self._answered(answers, asked.id, progress)
        finally:
            requests.delete()
            answers.delete()

    def _answered(self, answers, asked: int, progress) -> Answer:
        last_answer = time.monotonic()
        while True:
            sample = answers.receive()
            if sample is None:
                if time.monotonic() > last_answer + ANSWER_TIMEOUT_S:
                    raise NoDaemonError(
                        f'robot "{self.robot}": a request was not answered for {ANSWER_TIMEOUT_S} s; '
                        "torqued has stopped or was killed: look at its log and start it again"
                    )
                time.sleep(POLL_S)
                continue
            answer = Answer.from_buffer_copy(sample.payload().contents)
            del sample  # one at a time may be held
            if answer.id != asked:
                continue
            last_answer = time.monotonic()
            if answer.status == AnswerStatus.DONE:
                return answer
            if answer.status == AnswerStatus.REFUSED:
                raise RefusedError(text(answer.text))
            if progress is not None:
                progress(answer)

    def next_record(self, timeout_s: float = 1.0) -> SharedRecord:
        """The next record in order, a copy; raises `NoDaemonError` if none comes in time."""
        until = time.monotonic() + timeout_s
        while (record := self._receive()) is None:
            if time.monotonic() > until:
                raise self._silent(timeout_s)
            time.sleep(POLL_S)
        return record

    async def stream(self, timeout_s: float = 1.0) -> AsyncIterator[SharedRecord]:
        """The records in order, without end, for `async for`: other tasks run while none is there.

        Raises `NoDaemonError` if none comes within `timeout_s`. A task that keeps the event loop for longer than 128
        cycles loses records, which `lost` counts.
        """
        until = time.monotonic() + timeout_s
        while True:
            if (record := self._receive()) is not None:
                yield record
                until = time.monotonic() + timeout_s
            elif time.monotonic() > until:
                raise self._silent(timeout_s)
            else:
                await asyncio.sleep(POLL_S)

    def latest(self) -> Optional[SharedRecord]:
        """The newest record, if one has come since the last call; those before it are skipped."""
        newest = None
        while (record := self._receive()) is not None:
            newest = record
        return newest

    def records(self, timeout_s: float = 1.0) -> Iterator[SharedRecord]:
        """The records in order, without end; each waits at most `timeout_s`."""
        while True:
            yield self.next_record(timeout_s)

    def _silent(self, waited_s: float) -> NoDaemonError:
        return NoDaemonError(
            f'robot "{self.robot}": no record for {waited_s} s; torqued has stopped or '
            "was killed: look at its log and start it again"
        )

    def _receive(self) -> Optional[SharedRecord]:
        sample = self._records.receive()
        if sample is None:
            return None
        record = SharedRecord.from_buffer_copy(sample.payload().contents)
        sequence, newest = record.cycle.sequence, self._newest_sequence
        self._newest_sequence = sequence
        if newest is not None and sequence > newest:
            self.lost += sequence - newest - 1
        elif newest is not None:
            # The count restarted: another daemon took over, perhaps with another configuration.
            self.description = newest_message(self._descriptions, Description) or self.description
        return record

    def _open(self, channel: str, payload: type[ctypes.Structure], until: float):
        name = f"torqued/{self.robot}/{channel}"
        builder = self._node.service_builder(iox2.ServiceName.new(name))
        until = max(until, time.monotonic() + RETRY_S)
        while True:
            try:
                return builder.publish_subscribe(payload).open()
            except iox2.PublishSubscribeOpenError as e:
                if "IncompatibleTypes" in str(e):
                    raise OtherLayoutError(
                        f"service {name} does not carry {payload.type_name()}, for which this "
                        "program was made: use a daemon and a client of the same version"
                    ) from e
                if time.monotonic() > until:
                    raise self._no_daemon(channel) from e
            time.sleep(0.01)

    def _no_daemon(self, channel: str) -> NoDaemonError:
        return NoDaemonError(
            f'no torqued runs robot "{self.robot}": service '
            f"torqued/{self.robot}/{channel} was not offered in {self._run_dir}; start `torqued run CONFIG` as "
            "this user (or set TORQUED_RUN_DIR to the daemon's directory)"
        )


def text(name: ctypes.Array) -> str:
    """A name in a record as a string."""
    return bytes(name).split(b"\0", 1)[0].decode(errors="replace")


def newest_message(subscriber, payload: type[ctypes.Structure]):
    """The newest message that has arrived, a copy; the others are dropped."""
    newest = None
    while True:
        sample = subscriber.receive()
        if sample is None:
            return newest
        newest = payload.from_buffer_copy(sample.payload().contents)
        del sample  # one at a time may be held
