"""The algorithms and their tests alone: in an environment without the workbench's packages, files of
tests that use the workbench are left out.
"""

from importlib.util import find_spec
from pathlib import Path

HERE = Path(__file__).parent
# helpers of the tests that start a command of the workbench
USES = ("workbench", "satellites", "from healthy", "from setups", "from processes")

if find_spec("matplotlib") is None:
    collect_ignore = [
        str(path.relative_to(HERE))
        for path in HERE.rglob("test_*.py")
        if any(word in path.read_text(encoding="utf-8") for word in USES)
    ]
