"""Small notebooks in common style: a parameter ``x`` and some cells. A sweep must give what the
whole notebook gives at each setting, or refuse it.

Each has the tags that its author would give, right or wrong.
"""

import nbformat
from nbformat.v4 import new_code_cell, new_notebook

GLUE = "from myst_nb import glue\n"


def y(expression):
    """A cell that glues an expression."""
    return f"{GLUE}glue('y', {expression})"


# name -> cells with their tags: o once, f figure, - none
CASES = {
    "sum of a list": [("o", "a = [1, 2, 3]"), ("-", y("sum(a) * x"))],
    "append, then once": [
        ("o", "a = [1]"),
        ("-", "a.append(x)"),
        ("o", "n = len(a)"),
        ("-", y("n * x")),
    ],
    "figure draws a random number": [
        ("o", "import numpy as np\nrng = np.random.default_rng(0)"),
        ("f", "noise = rng.normal()"),
        ("-", y("rng.normal() * x")),
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
    "function of a global": [
        ("o", "def f():\n    return g * 2"),
        ("-", "g = x"),
        ("-", y("f()")),
    ],
    "function of the parameter": [("o", "def f():\n    return x * 2"), ("-", y("f()"))],
    "closure that counts": [
        (
            "o",
            "def make():\n    n = [0]\n    def f(v):\n        n[0] += v\n        return n[0]\n"
            "    return f\ninc = make()",
        ),
        ("-", "inc(x)"),
        ("-", y("inc(x)")),
    ],
    "file read once that varies": [
        ("-", "open('c.txt', 'w').write(str(x))"),
        ("o", "v = int(open('c.txt').read())"),
        ("-", y("v")),
    ],
    "query once": [
        ("o", "import pandas as pd\nd = pd.DataFrame({'a': [1, 2, 3]})"),
        ("o", "some = d.query('a > @x')"),
        ("-", y("len(some)")),
    ],
    "figure sorts in place": [
        ("o", "a = [3, 1, 2]"),
        ("f", "a.sort()\nprint(a)"),
        ("-", y("a[0] * x")),
    ],
    "a cell's own magic": [("o", "%%time\na = 3"), ("-", y("a * x"))],
    "a magic that hides the parameter": [("o", "%time a = 3 * x"), ("-", y("a"))],
    "exception in once": [("o", "a = 1 / 0"), ("-", y("x"))],
    "await": [
        ("o", "import asyncio\nasync def f(v):\n    await asyncio.sleep(0)\n    return v"),
        ("-", "v = await f(x)"),
        ("-", y("v")),
    ],
    "thread left by once": [
        (
            "o",
            "import threading, time\nt = threading.Thread(target=time.sleep, args=(30,), daemon=True)\nt.start()",
        ),
        ("-", y("x")),
    ],
    "the same result twice": [("o", y("5")), ("-", y("x"))],
}

# differs from one whole run to the next
UNREPEATABLE = [
    ("o", "import numpy as np"),
    ("-", y("np.random.normal() * x")),
]


def write(path, cells):
    """Write a notebook of cells with their tags (o, f, -); its parameter is ``x = 1``."""
    tags = {"o": ["once"], "f": ["figure"], "-": []}
    made = [new_code_cell("x = 1", metadata={"tags": ["parameters"]})]
    made += [new_code_cell(source, metadata={"tags": tags[tag]}) for tag, source in cells]
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    nbformat.write(new_notebook(cells=made, metadata={"kernelspec": kernel}), path)
    return path
