"""A thread that keeps a commander's lease while the program computes."""

import ctypes
import enum
import functools
import os
import threading
import time

from .layout import Mode, Reference

#: Interval of the references that renew the lease, s.
BEAT_S = 0.004
#: Longest time for which a program may be busy, s.
LONGEST_BUSY_S = 1.0
#: SCHED_FIFO priority of the thread where the process may have one: below every loop's.
PRIORITY = 10
#: Modes whose targets move on by themselves.
MOVING = (Mode.INVERSE_DYNAMICS, Mode.TORQUE_FEEDBACK_MOTION, Mode.LOW_GAIN_TRACKING)


class Meanwhile(enum.Enum):
    """What the robot does while the program computes."""

    #: It comes to rest within its limits, and holds.
    HOLD = enum.auto()
    #: Targets move on by their velocity and acceleration; torques and forces stay.
    EXTRAPOLATE = enum.auto()


def alone(method):
    """A method of a commander that sends by itself: no thread keeps the lease meanwhile."""

    @functools.wraps(method)
    def locked(self, *args, **kwargs):
        with self._lock:
            result = method(self, *args, **kwargs)
            if self._keeper is not None:
                self._keeper.sent()
            return result

    return locked


class Keeper:
    """The thread of one commander. It never asks for a lease that was lost."""

    def __init__(self, commander, busy_s: float, meanwhile: Meanwhile):
        self._commander = commander
        self._busy_s = min(busy_s, LONGEST_BUSY_S)
        self._meanwhile = meanwhile
        self._sent = time.monotonic()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="lease", daemon=True)
        self._thread.start()

    def sent(self) -> None:
        """The program sends a reference of its own."""
        self._sent = time.monotonic()

    def end(self) -> None:
        """Ends the thread."""
        self._ended.set()
        self._thread.join()

    def _run(self) -> None:
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(PRIORITY))
        except OSError:
            pass  # without the right, the thread is as any other
        while not self._ended.wait(BEAT_S):
            silent_s = time.monotonic() - self._sent
            if not BEAT_S <= silent_s <= self._busy_s:
                continue
            with self._commander._lock:
                # The program may have sent while this thread waited.
                silent_s = time.monotonic() - self._sent
                if BEAT_S <= silent_s <= self._busy_s:
                    self._commander._renew(lambda reference: carry_on(reference, self._meanwhile, silent_s))


def carry_on(reference: Reference, meanwhile: Meanwhile, after_s: float) -> None:
    """Changes a reference to what it is after a while without a newer one."""
    if meanwhile == Meanwhile.HOLD:
        reference.mode = Mode.HOLD
    elif reference.mode in MOVING:
        for joint in reference.joints:
            joint.q_d += after_s * (joint.dq_d + 0.5 * after_s * joint.ddq_d)
            joint.dq_d += after_s * joint.ddq_d


def copied(reference: Reference) -> Reference:
    """The same values in memory of their own."""
    copy = Reference()
    ctypes.memmove(ctypes.byref(copy), ctypes.byref(reference), ctypes.sizeof(Reference))
    return copy
