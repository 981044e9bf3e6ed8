"""How far apart the numbers are that different processors give: each is computed again with parts
of this one off.

A processor rounds in an order that depends on its instructions. NumPy, OpenBLAS, OpenCV and the C
library choose theirs when they are loaded, and each has a switch that takes some away. So one
machine can give the numbers of several.

    python tests/verify.py --only spread [--groups tables errata scoreboard chapters]
"""

import json
import os
import platform
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
# Below this a number is what rounding left of a zero: nothing of ours (mm, deg, px, shares, s) is
# quoted so small.
ZERO = 1e-6
SHOWN = 10  # lines of text that differ, at most


def instruction_sets():
    """Name -> environment of a process that does without some instructions."""
    import numpy as np

    loaded = np._core._multiarray_umath
    there = [name for name in loaded.__cpu_dispatch__ if loaded.__cpu_features__.get(name)]
    numpy_off = {"NPY_DISABLE_CPU_FEATURES": " ".join(there)} if there else {}
    sets = {"all": {}, "two threads": {"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2"}}
    if platform.machine() in ("x86_64", "AMD64"):
        sets["no AVX2, no FMA"] = {
            **numpy_off,
            "OPENBLAS_CORETYPE": "Sandybridge",
            "OPENCV_CPU_DISABLE": "AVX2,FP16",
            "OPENCV_IPP": "sse42",
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA",
        }
        sets["SSE alone"] = {
            **numpy_off,
            "OPENBLAS_CORETYPE": "Prescott",
            "OPENCV_IPP": "disabled",
            "OPENCV_CPU_DISABLE": "AVX2,FP16,AVX,SSE4.2,SSE4.1",
            "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-AVX",
        }
    else:
        sets["NumPy's baseline"] = numpy_off
    return sets


# --- what is computed, in a process of its own: name -> number or text


def tables():
    """A run of each shipped table whose numbers are measured in images, and how far the shipped
    ones are from it.
    """
    import numpy as np
    from helpers.tablerows import made_and_stored

    from workbench.studies.carrier import script

    found, shipped = {}, {}
    for name in ("bound", "elevation", "factors", "gallery"):
        for table in script(name).TABLES:
            if table.again:
                made, stored = (
                    rows.select_dtypes("number").stack() for rows in made_and_stored(name, table)
                )
                labels = [f"{table.name}: {', '.join(map(str, label))}" for label in made.index]
                found |= dict(zip(labels, made, strict=True))
                shipped |= dict(zip(labels, stored, strict=True))
    away = {
        name: abs(found[name] - shipped[name]) / max(abs(shipped[name]), ZERO) for name in found
    }
    assert np.isfinite(list(away.values())).all()
    return {**found, "shipped": away}


def errata():
    """Each effect of a misprint, by the printed and the corrected form, and the page's text of
    it.
    """
    from workbench.paper.errata import effects
    from workbench.paper.ledger import number_text

    found = {}
    for number, several in effects().items():
        for k, effect in enumerate(several):
            for form in ("printed", "corrected"):
                value = getattr(effect, form)
                found[f"{number}.{k} {form}"] = value
                found[f"{number}.{k} {form}, text"] = number_text(value)
                found[f"{number}.{k} {form}, holds"] = str(effect.holds(value))
    return found


def scoreboard():
    """Each claim's number, its digits on the board, and its verdict."""
    from workbench.cli import digits
    from workbench.studies.scoreboard import scoreboard as whole

    found = {}
    for row in whole().itertuples():
        if row.unit == "s":  # a time of this machine
            continue
        found[row.no] = row.ours
        found[f"{row.no}, text"] = f"{digits(row.ours)} {row.verdict}"
    return found


def chapters():
    """What each chapter, and each other page with code, glues and quotes."""
    from workbench.sweep.notebook import run_notebook

    found = {}
    for path in sorted([*ROOT.glob("notebooks/*.ipynb"), *ROOT.glob("book/*.ipynb")]):
        try:
            run = run_notebook(path)
        except Exception as error:
            found[f"{path.stem}: runs"] = str(error).splitlines()[-1]
            continue
        found[f"{path.stem}: runs"] = "yes"
        for name, value in run.results.items():
            found[f"{path.stem}: {name}"] = value if isinstance(value, (int, float)) else str(value)
        for name, text in _texts(run):
            found[f"{path.stem}: {name}, text"] = text
    return found


def _texts(run):
    """The numbers as the text quotes them."""
    for cell in run.notebook.cells:
        if cell.cell_type == "markdown":
            for name, form in re.findall(r"\{glue:text\}`(\w[^:`]*):?([^`]*)`", cell.source):
                if isinstance(value := run.results.get(name), (int, float)):
                    yield f"{name}:{form}", format(value, form)


GROUPS = {"tables": tables, "errata": errata, "scoreboard": scoreboard, "chapters": chapters}


# --- the comparison


def report(arguments):
    sets = instruction_sets()
    print(
        "spread: the largest relative difference of a number between instruction sets; texts that differ (numbers\n"
        f"as they are quoted, verdicts). Sets: {', '.join(sets)}"
    )
    print(f"{'group':12s}{'numbers':>9s}{'largest':>10s}{'texts':>8s}{'differ':>8s}  where")
    for group in arguments.groups:
        with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
            found = dict(zip(sets, pool.map(partial(_computed, group), sets.values()), strict=True))
        _line(group, found)


def _computed(group, environment):
    """The numbers of a group, in a process with an environment."""
    command = [sys.executable, "-m", "verification.spread", group]
    everything = {**os.environ, **environment}
    done = subprocess.run(
        command, cwd=ROOT / "tests", env=everything, capture_output=True, text=True
    )
    if done.returncode:
        raise RuntimeError(f"{group}: {done.stderr.splitlines()[-1]}")
    return json.loads(done.stdout.splitlines()[-1])


def _line(group, found):
    away = [values.pop("shipped", {}) for values in found.values()]
    names = list(dict.fromkeys(name for values in found.values() for name in values))
    numbers, texts, differ = {}, 0, []
    for name in names:
        values = [one.get(name, "missing") for one in found.values()]
        if any(isinstance(value, str) for value in values):
            texts += 1
            if len(set(values)) > 1:
                differ.append(f"{name}: {' | '.join(map(str, dict.fromkeys(values)))}")
        else:
            numbers[name] = relative_spread(values)
    worst = max(numbers, key=numbers.get)
    print(f"{group:12s}{len(numbers):9d}{numbers[worst]:10.1e}{texts:8d}{len(differ):8d}  {worst}")
    for line in differ[:SHOWN]:
        print(f"    {line}")
    if any(away):
        far = max((value, name) for one in away for name, value in one.items())
        print(
            f"    shipped tables (six digits) are at most {far[0]:.1e} from what was computed: {far[1]}"
        )


def relative_spread(values):
    """The largest difference of some numbers, relative to the largest of them; 0 if all are
    infinite or undefined.
    """
    finite = [value for value in values if value is not None and abs(value) < float("inf")]
    if len(finite) < len(values):
        return 0.0 if not finite else float("inf")
    return (max(finite) - min(finite)) / max(ZERO, *map(abs, finite))


if __name__ == "__main__":
    print(json.dumps(GROUPS[sys.argv[1]]()))
