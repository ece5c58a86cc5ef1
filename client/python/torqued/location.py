"""Where daemon and clients meet; the same rules as the Rust client's `Location`."""

import errno
import os
import re
import secrets
import sys
from pathlib import Path

import iceoryx2 as iox2

SYSTEM_DIR = "/run/torqued"

# In the run directory: the text that its objects' names in shared memory have.
NAMES_FILE = "shared_memory_names"
# iceoryx2's hash of the object's type, its name and its version.
NODE_COUNTER = "9204dd183d1c4d8e1ff592a30766ffa6765aa8b5_node.0_10_0.global_mgmt"
SHARED_MEMORY = "/dev/shm"
# Bytes that a client needs there while it connects.
CONNECTING = 1 << 20


class NoRoomError(RuntimeError):
    """Shared memory is full."""


class RunDirectoryError(RuntimeError):
    """The run directory cannot be used."""


def run_dir() -> Path:
    """`$TORQUED_RUN_DIR`; else `/run/torqued` for root and for the user that owns it; else
    `$XDG_RUNTIME_DIR/torqued`; else `~/.local/state/torqued/run`; else `/tmp/torqued-<uid>`."""
    if path := os.environ.get("TORQUED_RUN_DIR"):
        return Path(path)
    uid = os.geteuid()
    try:
        owned = os.stat(SYSTEM_DIR).st_uid == uid
    except OSError:
        owned = False
    if uid == 0 or owned:
        return Path(SYSTEM_DIR)
    if path := os.environ.get("XDG_RUNTIME_DIR"):
        return Path(path) / "torqued"
    # In /tmp another user could be there first.
    if path := os.environ.get("HOME"):
        return Path(path) / ".local/state/torqued/run"
    return Path(f"/tmp/torqued-{uid}")


def config(path: Path) -> iox2.config.Config:
    """The transport's configuration for that run directory, which is made if it is missing."""
    try:
        path.mkdir(mode=0o700, parents=True, exist_ok=True)
        path = path.resolve(strict=True)
        status = path.stat()
        owner = status.st_uid
    except OSError as e:
        raise RunDirectoryError(_advice(path, str(e))) from e
    if owner != os.geteuid():
        raise RunDirectoryError(
            _advice(path, f"belongs to user {owner}, this program runs as {os.geteuid()}")
        )
    if status.st_mode & 0o022:
        reason = f"other users may write into it: `chmod go-w {path}`"
        raise RunDirectoryError(_advice(path, reason))
    check_room()
    _make_node_counter(path)
    settings = iox2.config.default()
    settings.global_cfg.root_path = iox2.Path.new(str(path))
    settings.global_cfg.prefix = iox2.FileName.new(_prefix(path))
    return settings


def check_room() -> None:
    """Raises `NoRoomError` where shared memory is full: a process that touches it then is ended by
    SIGBUS."""
    try:
        status = os.statvfs(SHARED_MEMORY)
    except OSError:
        return
    free = status.f_bavail * status.f_frsize
    # A tmpfs without a limit has no size.
    if status.f_blocks != 0 and free < CONNECTING:
        raise NoRoomError(
            f"shared memory is full: {CONNECTING} bytes are needed in {SHARED_MEMORY}, {free} are "
            f"free; remove files there that no process uses, or make it larger: "
            f"`mount -o remount,size=256M {SHARED_MEMORY}`"
        )


def reserve(path: Path) -> None:
    """Gives memory to all files of that run directory, or raises `NoRoomError`."""
    prefix = _prefix(path.resolve())
    for name in os.listdir(SHARED_MEMORY):
        if not name.startswith(prefix):
            continue
        # Other processes remove theirs meanwhile; files that cannot be written are complete.
        try:
            file = os.open(f"{SHARED_MEMORY}/{name}", os.O_RDWR)
        except OSError:
            continue
        try:
            if size := os.fstat(file).st_size:
                os.posix_fallocate(file, 0, size)
        except OSError as e:
            if e.errno in (errno.ENOSPC, errno.ENOMEM):
                raise NoRoomError(f"shared memory is full: {size} bytes more are needed") from e
        finally:
            os.close(file)


def _prefix(path: Path) -> str:
    """Begins the names of this directory's objects in /dev/shm: a hash of its path (32-bit FNV-1a),
    and a random text that no other user can foresee."""
    value = 0x811C9DC5
    for byte in os.fsencode(path):
        value = (value ^ byte) * 0x01000193 & 0xFFFFFFFF
    return f"torqued_{value:08x}_{_names(path)}_"


def _names(path: Path) -> str:
    """The random text of that run directory; made by whoever comes first."""
    file = path / NAMES_FILE
    if not file.exists():
        _make_whole(file, f"{secrets.token_hex(8)}\n".encode())
    text = file.read_text().strip()
    if not re.fullmatch("[0-9a-fA-F]{16}", text):
        reason = f"its file {NAMES_FILE} has no 16 hexadecimal digits: remove that file while no torqued runs"
        raise RunDirectoryError(_advice(path, reason))
    return text


def _make_node_counter(path: Path) -> None:
    """Makes the object in which iceoryx2 counts its nodes, for this user alone: iceoryx2 itself would
    open it to all users."""
    file = Path(SHARED_MEMORY) / f"{_prefix(path)}{NODE_COUNTER}"
    if not file.exists():
        _make_whole(file, (10 << 16).to_bytes(8, sys.byteorder) + bytes(8))


def _make_whole(file: Path, content: bytes) -> None:
    """Makes the file, whole at once and never in the place of another's."""
    new = file.with_name(f"{file.name}.{secrets.token_hex(8)}")
    with open(os.open(new, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "wb") as out:
        out.write(content)
    try:
        os.link(new, file)
    except FileExistsError:
        pass
    finally:
        os.unlink(new)


def _advice(path: Path, reason: str) -> str:
    return (
        f"run directory {path}: {reason}; set TORQUED_RUN_DIR to a directory of this user, the "
        "same for daemon and clients"
    )
