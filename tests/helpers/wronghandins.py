"""What a class may hand in that is no plain answer: kinds of files that stop nobody, and programs
that want points, others' files or the machine. Each is a function that writes into a folder.
"""

import codecs
import json
import os

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
    "a cell of nulls": (notebook(RIGHT, "\x00").encode(), True),
    "a deep expression": (notebook(RIGHT, "x = " + "(" * 5000 + ")" * 5000).encode(), True),
    "empty": (b"", False),
    "deep": (b"[" * 200_000, False),
    "deep in a cell": (b'{"cells": ' + b"[" * 100_000 + b"]" * 100_000 + b"}", False),
    "a number": (b"4", False),
    "a list": (b"[]", False),
    "cells that are none": (b'{"cells": 4}', False),
    "a cell that is none": (b'{"cells": [4]}', False),
    "a source that is none": (notebook({"a": 1}).encode(), False),
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

# Programs that give no answer and want points for it, or more; each is told where the class is.
HOSTILE = {
    "ends at once": "import os; os._exit(0)",
    "ends in the first case": "import os\ndef filter_number(*a): os._exit(0)",
    "one right case, then an end": RIGHT.replace("answer_04_1", "_")
    + "import os\nright = filter_number\nn = [0]\ndef filter_number(*a):\n"
    "    n[0] += 1\n    if n[0] > 1: os._exit(0)\n    return right(*a)",
    "says that it is done": 'import os\nfor fd in range(3, 40):\n  try: os.write(fd, b\'{"done": true}\\n'
    '{"ready": true}\\n{"function": "filter_number", "there": true}\\n\')\n  except OSError: pass\nos._exit(0)',
    "equal to all": "class E(float):\n  __eq__ = lambda s, o: True\n  __sub__ = lambda s, o: 0\n"
    "answer_04_1 = {'gain': E(), 'mean': E(), 'variance': E()}\n"
    "def filter_number(*a): return [E()] * len(a[0])",
    "patches the comparison": "from workbench.course import plain, grading\nplain.equal = lambda *a: True\n"
    "grading.equal = plain.equal\ndef filter_number(*a): return 1",
    "takes the solution": "from workbench.course.exercises.kalman import *",
    "reads the solution": "import workbench, pathlib\n"
    "t = pathlib.Path(workbench.__file__).with_name('course') / 'exercises/kalman.py'\nexec(t.read_text())",
    "reads the values": "import tomllib; from trinolab.datasets import data_path\n"
    "e = tomllib.loads(data_path('exercises', '04.toml').read_text())\n"
    "answer_04_1 = {k: v['value'] for k, v in e['exercise'][0]['asked'].items()}",
    "runs the neighbour's": "exec(open(r'{klass}/ada/04_kalman.py').read())",
    "writes rows": "open(r'{klass}/.checked.jsonl', 'a').write('{{}}')",
    "writes points": "open(r'{klass}/points.csv', 'w').write('me,100')",
    "spoils the neighbour's": "import os; os.chmod(r'{klass}/ada/04_kalman.py', 0)",
    "removes the neighbour's": "import os; os.remove(r'{klass}/ada/04_kalman.py')",
    "links to the neighbour's": "import os; os.symlink(r'{klass}/ada/04_kalman.py', 'link.py')\n"
    "exec(open('link.py').read())",
    "ends its parents": "import os, signal\nos.kill(os.getppid(), signal.SIGKILL)",
    "traces its frames": "import sys\nf = sys._getframe()\nwhile f:\n"
    "  for v in list(f.f_locals.values()):\n    if hasattr(v, 'write'): v.write('{{\"done\": true}}\\n')\n"
    "  f = f.f_back",
    "memory": "x = bytearray(3 * 2**30)",
    "a long text": "answer_04_1 = {'gain': 'a' * 50_000_000}\n"
    "def filter_number(*a): raise ValueError('b' * 50_000_000)",
    "a deep list": "x = []\nfor _ in range(900): x = [x]\ndef filter_number(*a): return x",
    "orders to the terminal": "def filter_number(*a): raise ValueError('\\x1b[2J\\x1b]0;mine\\x07=cmd')",
    "ten thousand things": "def filter_number(*a): return [None] * 10_000",
    "a name that is none": "answer_04_1 = {1: 2, '\\ud800': 3}",
    "raises what is no error": "raise BaseException('me')",
    "closes all": "import os\nos.closerange(0, 100)",
    "shadows a module": "open('json.py', 'w').write('raise SystemExit')\ndef filter_number(*a): return 1",
    "a network": "import socket; socket.create_connection(('127.0.0.1', 9), timeout=1)",
}


def program(name, folder):
    return HOSTILE[name].replace("{klass}", str(folder)).replace("{{", "{").replace("}}", "}")


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
