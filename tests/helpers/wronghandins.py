"""What a class may hand in that is no plain answer: kinds of files that stop nobody, and programs
that want points, others' files or the machine. Each is a function that writes into a folder.
"""

import codecs
import json
import os

import pytest

from workbench.course import sandbox

CONFINED = pytest.mark.skipif(not sandbox.works(), reason="bwrap does not work here")

RIGHT = """
def filter_number(observations, mean, variance, growth, noise):
    means = []
    for observed in observations:
        variance = variance + growth
        expected = variance + noise
        if (observed - mean) ** 2 <= 9 * expected:
            gain = variance / expected
            mean = mean + gain * (observed - mean)
            variance = (1 - gain) * variance
        means.append(mean)
    return means
answer_04_1 = {"gain": 0.444, "mean": 6.889, "variance": 0.444}
"""
POINTS = 6  # of the two right answers


def notebook(*sources, version=4):
    key = "source" if version == 4 else "input"
    cells = [{"cell_type": "code", key: source} for source in sources]
    head = {"nbformat": version, "nbformat_minor": 0, "metadata": {}}
    return json.dumps(
        head | ({"cells": cells} if version == 4 else {"worksheets": [{"cells": cells}]})
    )


# of each kind the bytes of 04_kalman.ipynb, and whether they can be read
NOTEBOOKS = {
    "plain": (notebook(RIGHT).encode(), True),
    "byte-order mark": (codecs.BOM_UTF8 + notebook(RIGHT).encode(), True),
    "format 3": (notebook(RIGHT, version=3).encode(), True),
    "source as lines": (notebook(RIGHT.splitlines(keepends=True)).encode(), True),
    "an unknown cell": (notebook(RIGHT, "%%bash\nls").encode(), True),
    "a deep expression": (notebook(RIGHT, "x = " + "(" * 5000 + ")" * 5000).encode(), True),
    "empty": (b"", False),
    "deep": (b"[" * 200_000, False),
    "a list": (b"[]", False),
    "a cell that is none": (b'{"cells": [4]}', False),
    "sources that are none": (notebook([1, 2]).encode(), False),
    "a long number": (b'{"cells": ' + b"9" * 5000 + b"}", False),
    "no text": (b"\xff\xfe\x00\xd8" * 50, False),
    "cut off": (notebook(RIGHT).encode()[:-20], False),
    "a page": (b"<html><body>Sign in</body></html>", False),
}
# of 04_kalman.py
PROGRAMS = {
    "plain": (RIGHT.encode(), True),
    "byte-order mark": (codecs.BOM_UTF8 + RIGHT.encode(), True),
    "ends of Windows": (RIGHT.replace("\n", "\r\n").encode(), True),
    "Latin-1 with a word of it": (b"# coding: latin-1\n# \xe9\n" + RIGHT.encode(), True),
    "Latin-1 without": (b"# \xe9\n" + RIGHT.encode(), False),
    "another text's encoding": (b"# coding: rot13\n" + RIGHT.encode(), False),
}

# Writes a report, in which all is right but the numbers, wherever it can.
FORGED = """
import os
LINES = ['["at", "filter_number"]', *['["case", "filter_number", {"right": true, "points": 4}]'] * 6,
         '["value", "answer_04_1", {"right": true}]', '["points", "04.1", 2]', '["end"]']
def report(*a):
    for number in range(40):
        try: os.write(number, chr(10).join([*LINES, ""]).encode())
        except OSError: pass
    os._exit(0)
"""
WORKBENCH = (
    "import pathlib, workbench\ncourse = pathlib.Path(workbench.__file__).parent / 'course'\n"
)
AS_EXERCISES = WORKBENCH + "__package__ = 'workbench.course.exercises'\n"
ONES = "\nanswer_04_1 = {'gain': 0, 'mean': 0, 'variance': 0}\ndef filter_number(*a): return [1.0] * len(a[0])"
# Programs that give no answer and want points for it, or more; CLASS stands for the class's folder.
FORGING = {
    "one right case, then an end": RIGHT.replace("answer_04_1", "_")
    + "import os\nright = filter_number\nn = [0]\ndef filter_number(*a):\n"
    "    n[0] += 1\n    if n[0] > 1: os._exit(0)\n    return right(*a)",
    "a report from a case": FORGED + "filter_number = report",
    "a report at the end": FORGED + "import atexit; atexit.register(report)\nraise SystemExit",
    "a report from a child": FORGED + "if os.fork() == 0: os.setsid(); report()",
    "equal to all": "class E(float):\n  __eq__ = lambda s, o: True\n  __sub__ = lambda s, o: 0\n"
    "answer_04_1 = {'gain': E(), 'mean': E(), 'variance': E()}\n"
    "def filter_number(*a): return [E()] * len(a[0])",
    "patches the grader": "from workbench.course import plain, grading, child\nimport __main__\n"
    "plain.equal = grading.equal = lambda *a: True\ngrading.judge_outcomes = grading._right\n"
    "__main__.outcome = child.outcome = lambda *a: {'right': True}" + ONES,
    "patches what is built in": "import builtins\nbuiltins.abs = lambda *a: 0\n"
    "builtins.all = builtins.any = lambda *a: True\nbuiltins.sum = lambda *a: 6" + ONES,
    "patches JSON": "import json\nold = json.dumps\njson.dumps = lambda *a, **k: old({'points': 6})"
    + ONES,
    "searches the frames": "import sys\nf = sys._getframe()\nwhile f:\n"
    "  for name, v in [*f.f_locals.items(), *f.f_globals.items()]:\n"
    "    if name in ('solution', 'expected', 'wanted'): filter_number = v\n  f = f.f_back",
    "takes the exercise": "from workbench.course.exercises import exercise\n"
    "filter_number = exercise('04.2').solution\nanswer_04_1 = exercise('04.1').answer",
    "reads the solution": AS_EXERCISES + "exec((course / 'exercises/kalman.py').read_text())",
    "reads the values": "import tomllib; from trinolab.datasets import data_path\n"
    "e = tomllib.loads(data_path('exercises', '04.toml').read_text())\n"
    "answer_04_1 = {k: v['value'] for k, v in e['exercise'][0]['asked'].items()}",
    "reads the chapter": WORKBENCH + "chapter = course.parents[2] / 'notebooks/04_kalman.ipynb'\n"
    "answer_04_1 = {'gain': 0.444, 'mean': 6.889, 'variance': 0.444} if chapter.exists() else None",
    "runs the neighbour's": "exec(open(r'CLASS/ada/04_kalman.py').read())",
    "ends its parent": "import os, signal\nos.kill(os.getppid(), signal.SIGKILL)",
    "memory": "x = bytearray(3 * 2**30)",
    "many processes": "import os, time\nwhile len(os.listdir('/proc')) < 90 and os.fork(): pass\ntime.sleep(9)",
    "a long text": "answer_04_1 = {'gain': 'a' * 50_000_000}\n"
    "def filter_number(*a): raise ValueError('b' * 50_000_000)",
    "a long report": FORGED + "LINES = LINES * 200_000\nreport()",
    "a deep list": "x = []\nfor _ in range(900): x = [x]\ndef filter_number(*a): return x",
    "orders to the terminal": "def filter_number(*a): raise ValueError('\\x1b[2J\\x1b]0;mine\\x07=cmd')",
    "raises what is no error": "raise BaseException('me')",
    "closes all": "import os\nos.closerange(0, 100)",
    "shadows a module": "open('json.py', 'w').write('raise SystemExit')" + ONES,
}
# What a program cannot do inside `bwrap`; each raises.
FORBIDDEN = {
    "read the class": "open(r'CLASS/ada/04_kalman.py')",
    "read the accounts": "open('/etc/passwd')",
    "write the package": "(course / 'new.py').touch()",
    "write over the solutions": "(course / 'exercises/new.py').touch()",
    "write temporary files": "open('/tmp/new', 'w')",
    "write devices": "open('/dev/new', 'w')",
    "write a large file": "open('large', 'wb').write(bytes(2**27))",
    "mount": "shell('mount', '-t', 'tmpfs', 'none', '.')",
    "unmount in a namespace": "shell('unshare', '-rm', 'umount', course / 'exercises')",
    "see processes outside": "os.kill(PID, 0)",
    "reach the network": "socket.create_connection(('127.0.0.1', PORT), timeout=1)",
}
ATTEMPTS = WORKBENCH + "import os, socket, subprocess, sys\ndone = []\n"
ATTEMPTS += "def shell(*words): subprocess.run(words, check=True, stderr=subprocess.DEVNULL)\n"
for _name, _attempt in FORBIDDEN.items():
    ATTEMPTS += f"try: {_attempt}; done.append({_name!r})\nexcept Exception: pass\n"


def hand_in(folder, student, content, name="04_kalman.ipynb"):
    (folder / student).mkdir(exist_ok=True)
    (folder / student / name).write_bytes(content)


def alive(word):
    """Whether a process runs whose command has a word."""
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            with open(f"/proc/{pid}/cmdline", "rb") as file:
                if word.encode() in file.read():
                    return True
        except OSError:
            continue
    return False
