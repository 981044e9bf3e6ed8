"""Which test finds which slip: slips planted in modules of the package, and their tests run on each.

A module's tests are those of its name; a slip that these do not find is left to the others of their
folder. Results are kept by the code of the module and of its tests; a run plants a tenth of the slips that
are still missing, or all of them. A slip that no test finds is printed: it is harmless, or a test is
missing.
"""

import ast
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from pathlib import Path

import numpy as np
import pandas as pd
from slips import Slip, planted, slips
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
PACKAGE, TESTS = ROOT / "trinolab", ROOT / "tests" / "trinolab"
KEPT = ROOT / "_build" / "slips"
LONGEST_S = 300.0
APART = {"bench", "files"}
PLUMBING = {"__init__", "__main__", "checks", "datasets", "memory", "methods", "work", "workers"}
LEAST = 80  # per cent that are to be found in each module
Results = dict[str, list[str]]  # by a slip's words, the cases that find it


def modules() -> list[Path]:
    """The modules of chain, calibration, fit, uncertainty and slave."""
    found = sorted(PACKAGE.rglob("*.py"))
    return [p for p in found if p.stem not in PLUMBING and p.parent.name not in APART]


def tests_of(module: Path) -> list[list[Path]]:
    """The test files of a module, and the others of their folder."""
    files = sorted((TESTS / module.parent.relative_to(PACKAGE)).glob("test_*.py"))
    own = [path for path in files if path.name.startswith(f"test_{module.stem}")]
    return [own, [path for path in files if path not in own]]


def report(arguments) -> None:
    share = "all" if arguments.all_slips else "a tenth of those that are missing"
    each = f"{arguments.slips} slips a module, seed {arguments.slip_seed}"
    print(f"{each}, planted now: {share}. Not found:")
    found: dict[Path, Results] = {}
    with ThreadPoolExecutor(arguments.slip_workers) as pool:
        for module in modules():
            if not arguments.slip_modules or module.stem in arguments.slip_modules:
                found[module] = _results(module, arguments, pool)
                missed = [words for words, cases in found[module].items() if not cases]
                for words in sorted(missed):
                    print(f"  {module.relative_to(PACKAGE)} {words}", flush=True)
    _print_summary(found)


def _results(module: Path, arguments, pool: ThreadPoolExecutor) -> Results:
    """What is known of the first slips of a module, when some more have been planted."""
    source = module.read_text()
    code = source + "".join(path.read_text() for path in chain(*tests_of(module)))
    kept = KEPT / f"{module.stem}-{hashlib.sha256(code.encode()).hexdigest()[:12]}.json"
    known: Results = json.loads(kept.read_text()) if kept.is_file() else {}
    every = slips(source)
    order = np.random.default_rng(arguments.slip_seed).permutation(len(every))[: arguments.slips]
    usual = ast.unparse(ast.parse(source))
    # equal arguments that are swapped are no slip
    chosen = {every[k].words: every[k] for k in order if planted(source, every[k]) != usual}
    todo = [slip for words, slip in chosen.items() if words not in known]
    some = todo if arguments.all_slips else todo[: -(-len(chosen) // 10)]
    bar = tqdm(pool.map(_found, [module] * len(some), some), module.stem, len(some), leave=False)
    known |= {slip.words: cases for slip, cases in zip(some, bar, strict=True)}
    KEPT.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(known, indent=1))
    return {words: known[words] for words in chosen if words in known}


def _found(module: Path, slip: Slip) -> list[str]:
    """The cases that fail with a slip in a copy of the package.

    Bytecode and compiled loops are copied, too; the loops are compiled anew if the slip is in them.
    """
    left_out = shutil.ignore_patterns("*.nb[ci]") if _is_compiled(module) else None
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "trinolab"
        shutil.copytree(PACKAGE, copy, ignore=left_out)
        (copy / "data").symlink_to(ROOT / "data")
        (copy / module.relative_to(PACKAGE)).write_text(planted(module.read_text(), slip))
        found = (_failing(folder, files) for files in tests_of(module) if files)
        return next(filter(None, found), [])


def _failing(folder: str, files: list[Path]) -> list[str]:
    """The cases of test files that fail with the package in a folder."""
    command = [sys.executable, "-P", "-m", "pytest", *map(str, files)]
    options = ["-q", "--tb=no", "-rfE", "-p", "no:cacheprovider"]
    paths = os.pathsep.join([folder, str(ROOT / "book")])
    variables = {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        run = subprocess.run(
            command + options,
            cwd=ROOT,
            env={**os.environ, **variables},
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return ["(did not end)"]
    lines = [line.split() for line in run.stdout.splitlines()]
    cases = [words[1] for words in lines if words[:1] in (["FAILED"], ["ERROR"])]
    return cases or (["(nothing ran)"] if run.returncode not in (0, 1) else [])


def _is_compiled(module: Path) -> bool:
    """Whether compiled loops hold the module's code, or import from it."""
    sources = {path: path.read_text() for path in PACKAGE.rglob("*.py")}
    loops = {
        path: text
        for path, text in sources.items()
        if re.search(r"^(from|import) numba", text, re.M)
    }
    imports = re.compile(rf"\.{module.stem} import")
    return module in loops or any(imports.search(text) for text in loops.values())


def _print_summary(found: dict[Path, Results]) -> None:
    """Of each folder how many slips are found, by two test functions or more, and by how many cases;
    which modules lie low.
    """
    rows = []
    for module, results in found.items():
        for cases in results.values():
            functions = {case.partition("[")[0] for case in cases}
            about = {"folder": module.parent.name, "module": module.stem}
            rows.append({**about, "functions": len(functions), "cases": len(cases) or np.nan})
    table = pd.DataFrame(rows)
    table["found"] = 100.0 * (table["functions"] > 0)
    table["by two"] = 100.0 * (table["functions"] > 1)
    folders = table.groupby("folder", sort=False)
    summary = folders[["found", "by two", "cases"]].mean().assign(planted=folders.size())
    print("\nPer cent found, by two functions or more, and cases that find a slip that is found:")
    print(summary.to_string(float_format="{:.1f}".format))
    shares = table.groupby(["folder", "module"])["found"].mean()
    low = [f"{'/'.join(name)} {share:.0f}" for name, share in shares.items() if share < LEAST]
    print(f"below {LEAST} %: {', '.join(low) or 'none'}")
