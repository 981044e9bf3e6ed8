"""Keep a process in its place before it runs a student's code: ``python -m workbench.course.confined``.

On Linux this process and the one that works get namespaces of their own (users, processes, mounts,
network, messages), from which nothing outside can be reached or ended, and with which all that was
started in them ends. Landlock leaves them nothing to read but Python, the packages and their own
folder, in which alone they can write. Limits of the system bound memory and files. What a system has
not got is named, in words that a teacher reads.

Nothing is imported here but the standard library: a process with several threads, as NumPy makes
them, gets no namespace.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import signal
import struct
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

MEMORY = 2 * 2**30  # bytes that a process may hold
ADDRESSES = 8 * 2**30  # bytes that it may map, what it only reserves with them
FILE = 64 * 2**20  # bytes of a file that it writes
TASKS = 64  # processes and threads

# of <linux/sched.h>, <linux/prctl.h>, <linux/mount.h>, <linux/landlock.h>
NEW_USER, NEW_MOUNT, NEW_IPC, NEW_PID, NEW_NET = 1 << 28, 1 << 17, 1 << 27, 1 << 29, 1 << 30
DEATH_SIGNAL, DROP_FROM_BOUND, NO_NEW_PRIVILEGES, SUBREAPER = 1, 24, 38, 36
RECURSIVE, PRIVATE, BIND, AT_RECURSIVE, READ_ONLY = 1 << 14, 1 << 18, 1 << 12, 1 << 15, 1
SET_MOUNT_ATTRIBUTES, MAKE_RULES, ADD_RULE, OBEY_RULES = 442, 444, 445, 446
EXECUTE, WRITE, READ, LIST = 1, 2, 4, 8
OF_FILES = EXECUTE | WRITE | READ | 1 << 14  # the rights that a rule for a file may have
# of rights to files, by the version of Landlock: how many there are
RIGHTS = {1: 13, 2: 14, 3: 15, 4: 15, 5: 16}
# what Python and its libraries read of a system
SYSTEM = [
    "/bin",
    "/lib",
    "/lib32",
    "/lib64",
    "/usr",
    "/opt",
    "/etc/ld.so.cache",
    "/etc/localtime",
    "/etc/fonts",
    "/etc/mime.types",
    "/etc/alternatives",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/sys/devices/system/cpu",
]
DEVICES = ("/dev/null", "/dev/zero", "/dev/urandom", "/dev/random")


def main() -> None:
    """Confine this process to a folder, and work as `child` does."""
    own, hidden, readable = json.loads(sys.argv[1])
    missing = confine(Path(own), [Path(path) for path in hidden], [Path(path) for path in readable])
    from . import child

    child.main(missing)


def confine(own: Path, hidden: Sequence[Path], readable: Sequence[Path]) -> list[str]:
    """Confine this process, of which a descendant returns: the others wait for it to end.

    Parameters
    ----------
    own
        The folder that it may write in.
    hidden
        Folders that it may not read, although they lie in what it may.
    readable
        Files and folders that it may read, beside Python and its packages.

    Returns
    -------
    list of str
        What this system does not keep from a student's code, in words.
    """
    if not sys.platform.startswith("linux"):
        missing = ["files of others", "other processes", "the network"]
        if not _limited():
            missing.append("memory")
        os.chdir(own)
        return missing
    missing = []
    _end_with_the_parent()
    apart = _apart(own)
    if not apart:
        missing += ["other processes", "the network"]
    _only_the_child_returns(apart)
    _limited(apart)
    os.chdir(own)
    if not _read_and_write_no_more_than(own, hidden, readable):
        missing.insert(0, "files of others")
    elif not apart:
        missing.append("the rights of files of others")
    _drop_privileges()
    return missing


def _call(*arguments: object) -> int:
    """A call of the system's; OSError if it fails."""
    system = ctypes.CDLL(None, use_errno=True)
    as_long = [ctypes.c_long(it) if isinstance(it, int) else it for it in arguments]
    result = system.syscall(*as_long)
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


def _library(name: str, *arguments: object) -> None:
    """A function of the C library that returns 0; OSError if it fails."""
    if getattr(ctypes.CDLL(None, use_errno=True), name)(*arguments) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


def _control(option: int, value: int = 0) -> None:
    numbers = (ctypes.c_ulong(it) for it in (value, 0, 0, 0))
    _library("prctl", option, *numbers)


def _end_with_the_parent() -> None:
    _control(DEATH_SIGNAL, signal.SIGKILL)


def _apart(own: Path) -> bool:
    """Namespaces of its own, and no file to be changed but in its folder; whether there are any."""
    user, group = os.getuid(), os.getgid()
    try:
        _library("unshare", NEW_USER | NEW_MOUNT | NEW_IPC | NEW_PID | NEW_NET)
        for name, text in (
            ("setgroups", "deny"),
            ("uid_map", f"{user} {user} 1"),
            ("gid_map", f"{group} {group} 1"),
        ):
            Path("/proc/self", name).write_text(text, encoding="ascii")
    except OSError:
        return False
    with contextlib.suppress(OSError):  # Landlock is there as well
        folder = os.fsencode(own)
        _library("mount", None, b"/", None, ctypes.c_ulong(RECURSIVE | PRIVATE), None)
        _library("mount", folder, folder, None, ctypes.c_ulong(BIND), None)
        _mount_attributes(b"/", AT_RECURSIVE, to_set=READ_ONLY)
        _mount_attributes(folder, 0, to_clear=READ_ONLY)
    with contextlib.suppress(OSError):  # sockets of services lie there
        _library("mount", b"none", b"/run", b"tmpfs", ctypes.c_ulong(READ_ONLY), None)
    return True


def _mount_attributes(place: bytes, flags: int, to_set: int = 0, to_clear: int = 0) -> None:
    attributes = struct.pack("=QQQQ", to_set, to_clear, 0, 0)
    _call(SET_MOUNT_ATTRIBUTES, -100, place, flags, attributes, len(attributes))


def _only_the_child_returns(apart: bool) -> None:
    """Fork twice. The process between ends what is left when the one that returns has ended: as
    the first of a namespace, with which all of it ends, or one by one.
    """
    if between := os.fork():
        os._exit(_code_of(between))
    _end_with_the_parent()
    if not apart:
        with contextlib.suppress(OSError):
            _control(SUBREAPER, 1)
    worker = os.fork()
    if not worker:
        _end_with_the_parent()
        return
    code = _code_of(worker)
    if not apart:
        while left := list(_children_of(os.getpid())):
            for pid in left:
                with contextlib.suppress(OSError):
                    os.kill(pid, signal.SIGKILL)
            with contextlib.suppress(OSError):
                os.waitpid(-1, 0)
    os._exit(code)


def _code_of(pid: int) -> int:
    """Wait for a process, and for whatever else is this one's child meanwhile."""
    while True:
        ended, status = os.waitpid(-1, 0)
        if ended == pid:
            code = os.waitstatus_to_exitcode(status)
            return code if code >= 0 else 128 - code


def _children_of(pid: int) -> Iterator[int]:
    """The processes that a process has started and that are there, of Linux."""
    for folder in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError, ValueError):
            if _parent_of(folder) == pid:
                yield int(folder.name)


def _parent_of(folder: Path) -> int:
    behind_the_name = (folder / "stat").read_text(encoding="utf-8", errors="replace")
    return int(behind_the_name.rpartition(")")[2].split()[1])


def _limited(apart: bool = False) -> bool:
    """Bound memory and files; whether this system can."""
    try:
        import resource
    except ImportError:
        return False
    bounds = {"AS": ADDRESSES, "DATA": MEMORY, "FSIZE": FILE, "CORE": 0, "NOFILE": 256}
    if apart:  # else those of the same user elsewhere count as well
        bounds["NPROC"] = TASKS
    for name, most in bounds.items():
        with contextlib.suppress(AttributeError, ValueError, OSError):
            which = getattr(resource, f"RLIMIT_{name}")
            _, hard = resource.getrlimit(which)
            most = most if hard == resource.RLIM_INFINITY else min(most, hard)
            resource.setrlimit(which, (most, most))
    return True


def _read_and_write_no_more_than(
    own: Path, hidden: Sequence[Path], readable: Sequence[Path]
) -> bool:
    """Whether Landlock is there to say so."""
    try:
        version = _call(MAKE_RULES, None, 0, 1)
        all_rights = (1 << RIGHTS.get(version, 16)) - 1
        over_network = 3 if version >= 4 else 0
        scoped = 3 if version >= 6 else 0  # signals, and sockets without a file
        handled = struct.pack("=QQQ", all_rights, over_network, scoped)
        rules = _call(
            MAKE_RULES, handled, len(handled) if version >= 6 else 8 * (1 + (version > 3)), 0
        )
    except OSError:
        return False

    def allow(path: Path, rights: int) -> None:
        with contextlib.suppress(OSError):  # it is not there
            place = os.open(path, os.O_PATH | os.O_CLOEXEC)
            if not path.is_dir():
                rights &= OF_FILES
            _call(ADD_RULE, rules, 1, struct.pack("=Qi", rights & all_rights, place), 0)
            os.close(place)

    allow(own, all_rights)
    for name in DEVICES:
        allow(Path(name), READ | WRITE)
    for path in {*map(Path, SYSTEM), *_python(), *readable}:
        _allow_without(path, hidden, allow)
    for name in sys.path:
        allow(Path(name), LIST)
    _control(NO_NEW_PRIVILEGES, 1)
    _call(OBEY_RULES, rules, 0)
    os.close(rules)
    return True


def _python() -> set[Path]:
    """Where Python and its packages are."""
    places = {Path(sys.prefix), Path(sys.base_prefix), Path(os.__file__).parent}
    places |= {Path(name) for name in sys.path if name.endswith(("-packages", ".zip"))}
    # what a link in one of them leads to
    return places | {place.resolve() for place in places} | {Path(sys.executable).resolve()}


def _allow_without(path: Path, hidden: Sequence[Path], allow: Callable[[Path, int], None]) -> None:
    """Let a folder be read, but for what lies hidden in it."""
    place = path.resolve()
    if any(place == one or one in place.parents for one in hidden):
        return
    if not any(place in one.parents for one in hidden):
        allow(path, EXECUTE | READ | LIST)
        return
    allow(path, LIST)
    for inside in sorted(place.iterdir()):
        _allow_without(inside, hidden, allow)


def _drop_privileges() -> None:
    """Give up what an administrator may do, here or in a namespace of its own."""
    for number in range(64):
        with contextlib.suppress(OSError):
            _control(DROP_FROM_BOUND, number)
    with contextlib.suppress(OSError):
        _control(NO_NEW_PRIVILEGES, 1)
    version_3 = struct.pack("=Ii", 0x20080522, 0)
    with contextlib.suppress(OSError):
        _library("capset", version_3, bytes(24))


if __name__ == "__main__":
    main()
