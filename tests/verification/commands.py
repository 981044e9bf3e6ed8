"""Whole commands on wrong files, with 2 GB of memory: an answer, or one line of what is wrong."""

import io
import resource
import tempfile
from contextlib import chdir, redirect_stdout
from pathlib import Path

from fuzzing import fuzz_commands
from healthy import make_healthy, run

COUNT = 3  # instants of the recording
MOST = 2 << 30  # bytes that a command may have


def report(arguments) -> bool:
    """Whether nothing was found."""
    print(f"{arguments.commands} commands with 2 GB of memory, on files of which one is wrong")
    limits = resource.getrlimit(resource.RLIMIT_AS)
    with tempfile.TemporaryDirectory() as name, chdir(name):
        work, healthy = Path("work").absolute(), Path("healthy").absolute()
        work.mkdir()
        healthy.mkdir()
        make_healthy(healthy, COUNT)
        with chdir(healthy):
            with redirect_stdout(io.StringIO()):
                run("bag rec --out bag")
            (mcap,) = Path("bag").glob("*.mcap")
            about = Path("bag", "metadata.yaml")
            about.write_text(about.read_text().replace(mcap.name, "bag.mcap"))
            mcap.rename("bag/bag.mcap")
        healthy = Path("healthy").absolute()
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST, limits[1]))
        try:
            with chdir(work):
                codes = fuzz_commands(healthy, work, arguments.commands)
        except Exception as error:  # a finding is what this looks for
            print(f"finding: {type(error).__name__}: {error}", flush=True)
            return False
        finally:
            resource.setrlimit(resource.RLIMIT_AS, limits)
    print(f"answered {codes[0] + codes[1]}, refused {codes[2]}", flush=True)
    return True
