"""Small notebooks in common style: a parameter ``x`` and some cells. A sweep must give what the
whole notebook gives at each setting, or refuse it.

The cases of users' reports lie beside the checkout (`reported`); those here are our own, each with
the tags that its author would give, right or wrong.
"""

import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

import nbformat
from nbformat.v4 import new_code_cell, new_notebook

GLUE = "from myst_nb import glue\n"


def y(expression):
    """A cell that glues an expression."""
    return f"{GLUE}glue('y', {expression})"


# name -> cells with their tags: o once, f figure, - none
OWN = {
    "sum of a list": [("o", "a = [1, 2, 3]"), ("-", y("sum(a) * x"))],
    "append to a list": [("o", "a = [1]"), ("-", "a.append(x)"), ("-", y("sum(a)"))],
    "append, then once": [
        ("o", "a = [1]"),
        ("-", "a.append(x)"),
        ("o", "n = len(a)"),
        ("-", y("n * x")),
    ],
    "array in place": [
        ("o", "import numpy as np\na = np.ones(3)"),
        ("-", "a *= x"),
        ("-", y("float(a.sum())")),
    ],
    "array view": [
        ("o", "import numpy as np\na = np.ones(4)\nb = a[:2]"),
        ("-", "b[:] = x"),
        ("-", y("float(a.sum())")),
    ],
    "figure changes an array": [
        ("o", "import numpy as np\na = np.ones(3)"),
        ("f", "a[0] = 9"),
        ("-", y("float(a.sum()) * x")),
    ],
    "figure draws a random number": [
        ("o", "import numpy as np\nrng = np.random.default_rng(0)"),
        ("f", "noise = rng.normal()"),
        ("-", y("rng.normal() * x")),
    ],
    "global seed": [
        ("o", "import numpy as np\nnp.random.seed(3)"),
        ("-", "v = np.random.normal()"),
        ("-", y("v * x")),
    ],
    "global random numbers, no seed": [
        ("o", "import numpy as np"),
        ("-", y("np.random.normal() * x")),
    ],
    "python's random": [
        ("o", "import random\nrandom.seed(1)"),
        ("-", y("random.random() * x")),
    ],
    "random numbers drawn once": [
        ("o", "import numpy as np\na = np.random.default_rng(1).normal(size=5)"),
        ("-", y("float(a.mean()) + x")),
    ],
    "once reads the parameter": [("o", "a = 2 * x"), ("-", y("a"))],
    "once reads what varies": [("-", "a = 2 * x"), ("o", "b = a + 1"), ("-", y("b"))],
    "figure binds what is read": [("f", "a = 2"), ("-", y("a * x"))],
    "figure imports what is read": [("f", "import math"), ("-", y("math.pi * x"))],
    "import in every cell": [
        ("o", "import math\na = math.pi"),
        ("f", "import math\nprint(math.e)"),
        ("-", "import math\n" + y("a * math.sqrt(x)")),
    ],
    "once after, of another name": [("-", "a = x"), ("o", "b = 3"), ("-", y("a + b"))],
    "once after, of the same name": [("-", "a = x"), ("o", "a = 3"), ("-", y("a * x"))],
    "name read between two bindings": [
        ("o", "a = 1"),
        ("-", "b = a * x"),
        ("o", "a = 5"),
        ("-", y("a + b")),
    ],
    "loop variable in both": [
        ("o", "s = 0\nfor k in range(3):\n    s += k"),
        ("-", "t = 0\nfor k in range(x):\n    t += k"),
        ("-", y("s + t")),
    ],
    "loop variable left over": [
        ("o", "for k in range(3):\n    pass"),
        ("-", "for k in range(x):\n    pass"),
        ("-", y("k")),
    ],
    "function of a global": [
        ("o", "def f():\n    return g * 2"),
        ("-", "g = x"),
        ("-", y("f()")),
    ],
    "function of the parameter": [("o", "def f():\n    return x * 2"), ("-", y("f()"))],
    "function defined at each setting": [
        ("-", "def f():\n    return x * 2"),
        ("o", "a = 3"),
        ("-", y("f() * a")),
    ],
    "closure that counts": [
        (
            "o",
            "def make():\n    n = [0]\n    def f(v):\n        n[0] += v\n        return n[0]\n"
            "    return f\ninc = make()",
        ),
        ("-", "inc(x)"),
        ("-", y("inc(x)")),
    ],
    "generator": [
        ("o", "g = (k * k for k in range(9))"),
        ("-", "next(g)"),
        ("-", y("next(g) * x")),
    ],
    "iterator shared with a figure": [
        ("o", "g = iter([1, 2, 3])"),
        ("f", "next(g)"),
        ("-", y("next(g) * x")),
    ],
    "open file": [
        ("o", "open('a.txt', 'w').write('1\\n2\\n3\\n')\nf = open('a.txt')"),
        ("-", "f.readline()"),
        ("-", y("int(f.readline()) * x")),
    ],
    "file written at each setting": [
        ("-", "open('b.txt', 'w').write(str(x))"),
        ("-", y("int(open('b.txt').read())")),
        ("o", "z = 1"),
    ],
    "file read once that varies": [
        ("-", "open('c.txt', 'w').write(str(x))"),
        ("o", "v = int(open('c.txt').read())"),
        ("-", y("v")),
    ],
    "environment variable": [
        ("-", "import os\nos.environ['SCALE'] = str(x)"),
        ("o", "import os\nscale = int(os.environ.get('SCALE', '0'))"),
        ("-", y("scale")),
    ],
    "working folder": [
        ("o", "import os\nos.makedirs('deep', exist_ok=True)\nos.chdir('deep')"),
        ("-", y("len(os.getcwd()) > x")),
    ],
    "class attribute": [
        ("o", "class Box:\n    items = []"),
        ("-", "Box.items.append(x)"),
        ("-", y("sum(Box.items)")),
    ],
    "dataclass": [
        ("o", "from dataclasses import dataclass\n@dataclass\nclass P:\n    v: int = 2"),
        ("-", y("P(x).v + P().v")),
    ],
    "cached function": [
        ("o", "from functools import lru_cache\n@lru_cache\ndef f(v):\n    return v * 3"),
        ("-", y("f(x) + f.cache_info().misses")),
    ],
    "cache that a figure fills": [
        ("o", "from functools import lru_cache\n@lru_cache\ndef f(v):\n    return v * 3"),
        ("f", "f(1); f(2)"),
        ("-", y("f(x) + f.cache_info().misses")),
    ],
    "query of a frame": [
        ("o", "import pandas as pd\nd = pd.DataFrame({'a': [1, 2, 3]})"),
        ("-", y("len(d.query('a > @x'))")),
    ],
    "query once": [
        ("o", "import pandas as pd\nd = pd.DataFrame({'a': [1, 2, 3]})"),
        ("o", "some = d.query('a > @x')"),
        ("-", y("len(some)")),
    ],
    "exec once": [("o", "exec('v = x + 1')"), ("-", y("v"))],
    "globals once": [("o", "v = globals()['x'] + 1"), ("-", y("v"))],
    "drop in place": [
        ("o", "import pandas as pd\nd = pd.DataFrame({'a': [1, 2, 3]})"),
        ("-", "d.drop(index=0, inplace=True)"),
        ("-", y("int(d.a.sum()) * x")),
    ],
    "figure sorts in place": [
        ("o", "a = [3, 1, 2]"),
        ("f", "a.sort()\nprint(a)"),
        ("-", y("a[0] * x")),
    ],
    "rcParams": [
        ("o", "import matplotlib.pyplot as plt\nplt.rcParams['lines.linewidth'] = 3"),
        ("f", "plt.plot([1, 2]);"),
        ("-", y("plt.rcParams['lines.linewidth'] * x")),
    ],
    "print options": [
        ("o", "import numpy as np\nnp.set_printoptions(precision=2)"),
        ("-", y("len(str(np.array([1 / 3]))) * x")),
    ],
    "displayed precision": [("-", "%precision 2\nz = x / 3"), ("o", "a = 1"), ("-", y("z"))],
    "a cell's own magic": [("o", "%%time\na = 3"), ("-", y("a * x"))],
    "a magic that hides the parameter": [("o", "%time a = 3 * x"), ("-", y("a"))],
    "assertion in a figure's cell": [("f", "assert x < 2"), ("-", y("x"))],
    "assertion at each setting": [("o", "a = 1"), ("-", "assert x < 2"), ("-", y("a"))],
    "exception in once": [("o", "a = 1 / 0"), ("-", y("x"))],
    "await": [
        ("o", "import asyncio\nasync def f(v):\n    await asyncio.sleep(0)\n    return v"),
        ("-", "v = await f(x)"),
        ("-", y("v")),
    ],
    "text and number": [
        ("o", "a = 2"),
        ("-", y("a * x") + "\nglue('word', 'high' if x > 1 else 'low')"),
    ],
    "thread left by once": [
        (
            "o",
            "import threading, time\nt = threading.Thread(target=time.sleep, args=(30,), daemon=True)\nt.start()",
        ),
        ("-", y("x")),
    ],
    "result of a once cell": [("o", y("5")), ("-", f"{GLUE}glue('z', x)")],
    "the same result twice": [("o", y("5")), ("-", y("x"))],
}


def reported():
    """The cases of users' reports by name, their cells without tags; empty where they are absent."""
    folder = (
        Path(os.environ.get("TRINOLAB_DATA", "data")).parent / "review" / "trials" / "recordings"
    )
    path = folder / "sweep_flow_cases.py"
    if not path.is_file():
        return {}
    runner = ModuleType("sweep_flow")  # theirs belongs to what was swept before
    runner.main = None
    sys.modules["sweep_flow"] = runner
    try:
        spec = importlib.util.spec_from_file_location("sweep_flow_cases", path)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
    finally:
        del sys.modules["sweep_flow"]
    return module.C


def write(path, cells):
    """Write a notebook of cells with their tags (o, f, -); its parameter is ``x = 1``."""
    tags = {"o": ["once"], "f": ["figure"], "-": []}
    made = [new_code_cell("x = 1", metadata={"tags": ["parameters"]})]
    made += [new_code_cell(source, metadata={"tags": tags[tag]}) for tag, source in cells]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    nbformat.write(new_notebook(cells=made, metadata={"kernelspec": kernel}), path)
    return path
