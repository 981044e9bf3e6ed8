"""Which test finds which slip: slips planted in modules of the package, and their tests run on each.

A module's tests are those of its name, else those of its folder. A slip that no test finds is printed;
it is harmless, or a test is missing. Results are kept by the code of the module and of its tests.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from slips import Slip, planted, slips
from tqdm import tqdm

ROOT = Path(__file__).resolve().parents[2]
PACKAGE, TESTS = ROOT / "trinolab", ROOT / "tests" / "trinolab"
KEPT = ROOT / "_build" / "slips"
SEED = 7
LONGEST_S = 300.0
PARTS = (".", "workspace", "calibration", "identity", "estimators", "uncertainty", "slave")
PLUMBING = {"__init__", "__main__", "checks", "datasets", "memory", "methods", "work", "workers"}


def modules() -> list[Path]:
    """The modules of chain, calibration, fit, uncertainty and slave."""
    found = [path for part in PARTS for path in sorted((PACKAGE / part).glob("*.py"))]
    return [path for path in found if path.stem not in PLUMBING]


def tests_of(module: Path) -> list[Path]:
    """The test files of a module."""
    folder = TESTS / module.parent.relative_to(PACKAGE)
    own = sorted(folder.glob(f"test_{module.stem}*.py"))
    return own or sorted(folder.glob("test_*.py"))


def report(arguments) -> None:
    print(
        f"{arguments.slips} slips a module, seed {SEED}: planted, found, found by two tests, "
        "cases that find one (mean), tests; the fewest functions that find each slip twice"
    )
    with ThreadPoolExecutor(arguments.slip_workers) as pool:
        for module in modules():
            if not arguments.slip_modules or module.stem in arguments.slip_modules:
                _print(module, _results(module, arguments.slips, pool))


def _results(module: Path, count: int, pool: ThreadPoolExecutor) -> dict[str, list[str]]:
    """The cases that find each slip, by its words."""
    source = module.read_text()
    code = source + "".join(path.read_text() for path in tests_of(module))
    name = f"{module.stem}-{count}-{hashlib.sha256(code.encode()).hexdigest()[:12]}.json"
    kept = KEPT / name
    if kept.is_file():
        return json.loads(kept.read_text())
    every = slips(source)
    chosen = np.random.default_rng(SEED).permutation(len(every))[:count]
    with tempfile.TemporaryDirectory() as folder:
        runs = [pool.submit(_found, module, every[k], Path(folder) / str(k)) for k in chosen]
        found = [run.result() for run in tqdm(runs, desc=module.stem, leave=False)]
    results = {every[k].words: cases for k, cases in zip(chosen, found, strict=True)}
    KEPT.mkdir(parents=True, exist_ok=True)
    kept.write_text(json.dumps(results, indent=1))
    return results


def _found(module: Path, slip: Slip, folder: Path) -> list[str]:
    """The cases that fail with a slip in a copy of the package."""
    copy = folder / "trinolab"
    shutil.copytree(PACKAGE, copy, ignore=shutil.ignore_patterns("__pycache__"))
    (copy / "data").symlink_to(ROOT / "data")
    (copy / module.relative_to(PACKAGE)).write_text(planted(module.read_text(), slip))
    command = [sys.executable, "-P", "-m", "pytest", *map(str, tests_of(module))]
    options = ["-q", "--tb=no", "-rfE", "-p", "no:cacheprovider", "--durations=0"]
    paths = os.pathsep.join([str(folder), str(ROOT / "book")])
    try:
        run = subprocess.run(
            command + options,
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            timeout=LONGEST_S,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return ["(did not end)"]
    finally:
        shutil.rmtree(copy)
    lines = [line.split() for line in run.stdout.splitlines()]
    cases = [words[1] for words in lines if words[:1] in (["FAILED"], ["ERROR"])]
    return cases or (["(nothing ran)"] if run.returncode not in (0, 1) else [])


def _print(module: Path, results: dict[str, list[str]]) -> None:
    found = {words: cases for words, cases in results.items() if cases}
    functions = {
        words: {case.partition("[")[0] for case in cases} for words, cases in found.items()
    }
    twice = sum(len(names) > 1 for names in functions.values())
    mean = np.mean([len(cases) for cases in found.values()]) if found else 0.0
    needed = fewest(functions)
    names = sorted(path.name for path in tests_of(module))
    print(
        f"{module.relative_to(PACKAGE)!s:36} {len(results):4d} {len(found):4d} {twice:4d} {mean:6.1f}"
        f"  {', '.join(names)}; {len(needed)}"
    )
    for words in sorted(set(results) - set(found)):
        print(f"      not found: {words}")


def fewest(functions: dict[str, set[str]], times: int = 2) -> list[str]:
    """A small set of test functions in which `times` of them find each slip, where so many do; the
    one that finds most of what is still missing comes first.
    """
    missing = {words: min(times, len(names)) for words, names in functions.items()}
    chosen: list[str] = []
    while any(missing.values()):
        open_slips = [words for words, count in missing.items() if count]
        counts: dict[str, int] = {}
        for words in open_slips:
            for name in functions[words] - set(chosen):
                counts[name] = counts.get(name, 0) + 1
        best = max(sorted(counts), key=counts.__getitem__)
        chosen.append(best)
        for words in open_slips:
            missing[words] -= best in functions[words]
    return chosen
