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

# Lines of a report in which all is right but the numbers; a program writes them wherever it can.
FORGED = """
import json, os
LINES = [["at", "filter_number"], *[["case", "filter_number", {"returned": {"shape": [], "numbers": [1]},
         "right": True, "points": 4, "printed": False, "changed": []}]] * 6, ["value", "answer_04_1",
         {"mapping": {"points": 2}}], ["points", "04.1", 2], ["verdict", "04.2", True, 4, 4], ["end"]]
TEXT = ("".join(json.dumps(line) + chr(10) for line in LINES)).encode()
"""
# Programs that give no answer and want points for it, or more; CLASS stands for the class's folder.
FORGING = {
    "ends at once": "import os; os._exit(0)",
    "ends by an exception": "raise SystemExit(0)",
    "ends in the first case": "import os\ndef filter_number(*a): os._exit(0)",
    "one right case, then an end": RIGHT.replace("answer_04_1", "_")
    + "import os\nright = filter_number\nn = [0]\ndef filter_number(*a):\n"
    "    n[0] += 1\n    if n[0] > 1: os._exit(0)\n    return right(*a)",
    "a report on all files": FORGED + "for number in range(40):\n"
    "    try: os.write(number, TEXT)\n    except OSError: pass\nos._exit(0)",
    "a report from a case": FORGED + "def filter_number(*a):\n    for number in range(40):\n"
    "        try: os.pwrite(number, TEXT, 0)\n        except OSError: pass\n    os._exit(0)",
    "a report at the end": FORGED + "import atexit\n"
    "atexit.register(lambda: [os.write(n, TEXT) for n in range(3, 6)])\ndef filter_number(*a): exit()",
    "a report from a thread": FORGED + "import threading, time\ndef later():\n    time.sleep(0.1)\n"
    "    for number in range(3, 40):\n        try: os.write(number, TEXT)\n"
    "        except OSError: pass\n    os._exit(0)\nthreading.Thread(target=later).start()\n"
    "def filter_number(*a): time.sleep(1)",
    "a report from a child left behind": FORGED + "if os.fork() == 0:\n    os.setsid()\n"
    "    for number in range(3, 40):\n        try: os.write(number, TEXT)\n"
    "        except OSError: pass\n    os._exit(0)",
    "hooks": "import sys, atexit, os\nsys.excepthook = lambda *a: os._exit(0)\n"
    "atexit.register(os._exit, 0)\nsys.settrace(lambda *a: None)\nraise ValueError",
    "equal to all": "class E(float):\n  __eq__ = lambda s, o: True\n  __sub__ = lambda s, o: 0\n"
    "answer_04_1 = {'gain': E(), 'mean': E(), 'variance': E()}\n"
    "def filter_number(*a): return [E()] * len(a[0])",
    "patches the grader": "from workbench.course import plain, grading, running, child\n"
    "for module in (plain, grading): module.equal = lambda *a: True\n"
    "grading.judge_outcomes = grading._right\nchild.outcome = lambda f, c: {'right': True}\n"
    "import __main__\n__main__.outcome = child.outcome\ndef filter_number(*a): return 1",
    "patches NumPy": "import numpy as np\n"
    "np.isclose = np.allclose = lambda *a, **k: np.True_\nnp.abs = lambda *a: np.zeros(1)\n"
    "answer_04_1 = {'gain': 0, 'mean': 0, 'variance': 0}\ndef filter_number(*a): return [1.0] * len(a[0])",
    "patches what is built in": "import builtins\nbuiltins.abs = lambda *a: 0\n"
    "builtins.all = builtins.any = lambda *a: True\nbuiltins.sum = lambda *a: 6\n"
    "answer_04_1 = {'gain': 0, 'mean': 0, 'variance': 0}\ndef filter_number(*a): return [1.0] * len(a[0])",
    "patches JSON": "import json\nold = json.dumps\n"
    "json.dumps = lambda it, **k: old({'right': True, 'points': 6})\ndef filter_number(*a): return 1",
    "searches the memory": "import gc\nfound = [o for o in gc.get_objects() if callable(o) and "
    "getattr(o, '__name__', '') in ('filter_number', '_filter_number')]\n"
    "filter_number = found[0] if found else None",
    "searches the frames": "import sys\nf = sys._getframe()\nwhile f:\n"
    "  for name, v in list(f.f_locals.items()) + list(f.f_globals.items()):\n"
    "    if name in ('solution', 'expected', 'wanted', 'right'): filter_number = v\n"
    "    if hasattr(v, 'write'): v.write('[\"end\"]\\n')\n  f = f.f_back",
    "takes the solution": "from workbench.course.exercises.kalman import *",
    "takes the exercise": "from workbench.course.exercises import exercise\n"
    "filter_number = exercise('04.2').solution\nanswer_04_1 = exercise('04.1').answer",
    "asks the grader": "from workbench.course import check\nimport os\n"
    "os.environ.pop('TRINOLAB_BEING_CHECKED')\ncheck('04.1', {'gain': 0, 'mean': 0, 'variance': 0})",
    "reads the solution": "import workbench, pathlib\n"
    "t = pathlib.Path(workbench.__file__).with_name('course') / 'exercises/kalman.py'\n"
    "__package__ = 'workbench.course.exercises'\nexec(t.read_text())",
    "reads the compiled solution": "import workbench, pathlib, marshal\n"
    "t = pathlib.Path(workbench.__file__).with_name('course') / 'exercises/__pycache__'\n"
    "__package__ = 'workbench.course.exercises'\nexec(marshal.loads(next(t.glob('kalman.*.pyc')).read_bytes()[16:]))",
    "reads the values": "import tomllib; from trinolab.datasets import data_path\n"
    "e = tomllib.loads(data_path('exercises', '04.toml').read_text())\n"
    "answer_04_1 = {k: v['value'] for k, v in e['exercise'][0]['asked'].items()}",
    "reads the chapter": "import json, pathlib, trinolab\n"
    "t = pathlib.Path(trinolab.__file__).parents[1] / 'notebooks/04_kalman.ipynb'\n"
    "answer_04_1 = {'gain': 0.444, 'mean': 6.889, 'variance': 0.444} if t.exists() else None",
    "runs the neighbour's": "exec(open(r'CLASS/ada/04_kalman.py').read())",
    "links to the neighbour's": "import os; os.symlink(r'CLASS/ada/04_kalman.py', 'link.py')\n"
    "exec(open('link.py').read())",
    "writes rows": "open(r'CLASS/.checked.jsonl', 'a').write('{}')",
    "writes points": "open(r'CLASS/points.csv', 'w').write('me,100')",
    "spoils the neighbour's": "import os; os.chmod(r'CLASS/ada/04_kalman.py', 0)",
    "removes the neighbour's": "import os; os.remove(r'CLASS/ada/04_kalman.py')",
    "leaves modules behind": "import os, pathlib, sys\n"
    "for place in ('.', *sys.path, os.path.expanduser('~'), '/tmp'):\n"
    "    for name in ('sitecustomize', 'json', 'numpy', 'usercustomize'):\n"
    "        try: pathlib.Path(place or '.', name + '.py').write_text('raise SystemExit')\n"
    "        except OSError: pass\ndef filter_number(*a): return 1",
    "ends its parents": "import os, signal\nos.kill(os.getppid(), signal.SIGKILL)",
    "ends all": "import os, signal\nos.kill(-1, signal.SIGKILL)",
    "memory": "x = bytearray(3 * 2**30)",
    "many processes": "import os, time\nfor _ in range(60):\n  if os.fork() == 0: time.sleep(60)\ntime.sleep(60)",
    "a long text": "answer_04_1 = {'gain': 'a' * 50_000_000}\n"
    "def filter_number(*a): raise ValueError('b' * 50_000_000)",
    "a long report": "import os\nfor number in range(1, 20):\n  try:\n"
    "    for _ in range(100_000): os.write(number, b'[' * 1000 + b'\\n')\n  except OSError: pass",
    "a deep list": "x = []\nfor _ in range(900): x = [x]\ndef filter_number(*a): return x",
    "a less deep list": "x = []\nfor _ in range(300): x = [x]\ndef filter_number(*a): return x\n"
    "answer_04_1 = {'gain': x, 'mean': x}",
    "orders to the terminal": "def filter_number(*a): raise ValueError('\\x1b[2J\\x1b]0;mine\\x07=cmd')",
    "ten thousand things": "def filter_number(*a): return [None] * 10_000",
    "a name that is none": "answer_04_1 = {1: 2, '\\ud800': 3}",
    "raises what is no error": "raise BaseException('me')",
    "closes all": "import os\nos.closerange(0, 100)",
    "shadows a module": "open('json.py', 'w').write('raise SystemExit')\ndef filter_number(*a): return 1",
}
# What a program cannot do inside `bwrap`; each raises.
FORBIDDEN = {
    "read the class": "open(r'CLASS/ada/04_kalman.py')",
    "list the class": "os.listdir(r'CLASS')",
    "read the accounts": "open('/etc/passwd')",
    "write the package": "pathlib.Path(workbench.__file__).with_name('new.py').write_text('')",
    "change the package": "os.utime(workbench.__file__)",
    "write over the solutions": "pathlib.Path(workbench.__file__).with_name('course').joinpath('exercises/a').touch()",
    "write Python": "pathlib.Path(sys.prefix, 'new.pth').write_text('')",
    "write temporary files": "open('/tmp/new', 'w')",
    "write at the top": "open('/new', 'w')",
    "write devices": "open('/dev/new', 'w')",
    "unmount": "subprocess.run(['umount', os.path.join(os.path.dirname(workbench.__file__), "
    "'course/exercises')], check=True, stderr=-3)",
    "mount": "subprocess.run(['mount', '-t', 'tmpfs', 'none', '.'], check=True, stderr=-3)",
    "unmount in a namespace": "subprocess.run(['unshare', '-rm', 'umount', os.path.join("
    "os.path.dirname(workbench.__file__), 'course/exercises')], check=True, stderr=-3)",
    "see processes outside": "os.kill(PID, 0)",
    "reach the network": "socket.create_connection(('127.0.0.1', PORT), timeout=1)",
    "write a large file": "open('large', 'wb').write(bytes(2**27))",
}


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
