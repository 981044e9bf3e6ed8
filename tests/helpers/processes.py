"""Commands as processes of their own: started, watched until something is to be seen, and stopped.

Nothing here depends on how fast a machine is. A process that must not go on too far waits for a
file, which the test makes when it has seen what it waited for.
"""

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

# no command of a test takes so long, however busy the machine is: one that does hangs
HANGS_S = 900.0
CLI = "import sys; from workbench.cli import main; sys.exit(main(sys.argv[1:]))"
GATE = "go"  # the file, in the working folder, that a process waits for


def started(line, code=CLI, prepare=None, **options):
    """A command line as a process that answers Ctrl-C: the background jobs of some shells ignore
    it, and so would it.

    `code` is what runs in place of the command, with the line as its arguments; `prepare` is called
    in the new process.
    """

    def before():
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        if prepare is not None:
            prepare()

    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **options}
    return subprocess.Popen(
        [sys.executable, "-c", code, *shlex.split(line)], text=True, preexec_fn=before, **options
    )


def ended(process):
    """Exit code, and the lines on standard error."""
    _, err = process.communicate(timeout=HANGS_S)
    return process.returncode, err.splitlines(keepends=True)


def wait_until(seen, process=None):
    """Wait until `seen` gives something true, and return that; fail if the process ends before."""
    end = time.monotonic() + HANGS_S
    while not (found := seen()):
        assert process is None or process.poll() is None, f"ended too soon: {process.communicate()}"
        assert time.monotonic() < end, "hangs"
        time.sleep(0.005)
    return found


def is_running(pid):
    """Whether a process goes on; one that has ended may wait for somebody to ask how."""
    import psutil  # where no process is asked about it need not be there

    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def open_gate():
    """Let the processes go on that wait for it."""
    Path(GATE).touch()


def without_display(code, **changes):
    """Exit code, output and errors of a Python that has no display, and to which a warning is an
    error.
    """
    environment = {name: it for name, it in os.environ.items() if "DISPLAY" not in name}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        capture_output=True,
        text=True,
        env=environment | changes,
    )
    return done.returncode, done.stdout.strip(), done.stderr
