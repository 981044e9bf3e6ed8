"""The names of the estimators, in a module that loads nothing: the command line knows them before
it computes.
"""

PAPER = "paper"  # Eq. 20-24
BEST = "patches"  # the most accurate that keeps up with 30 frames per second
ESTIMATORS = (PAPER, "reprojection", BEST)
# what --method may name -> the estimator
METHODS = {**{name: name for name in ESTIMATORS}, "best": BEST}
# The estimator of ``trinolab.measure``, ``trinolab.track`` and each command where none is named.
DEFAULT = "best"
# estimators of older versions -> what does their work
_SUCCESSORS = {
    "outline": BEST,
    "weighted": "reprojection",
    "paper_checked": f"{PAPER} with check=True (--check)",
}


def estimator_of(method: str, name: str = "method") -> str:
    """The estimator that ``--method`` names. Raises ValueError, with the argument's name, for
    another word; for an estimator of older versions it names the successor.
    """
    if isinstance(method, str) and method in _SUCCESSORS:
        raise ValueError(f"{name}: {method!r} is gone, take {_SUCCESSORS[method]}")
    if not isinstance(method, str) or method not in METHODS:
        raise ValueError(f"{name}: expected one of {', '.join(METHODS)}, got {method!r}")
    return METHODS[method]


def check_option(check: bool, estimator: str | None, name: str = "check") -> None:
    """Refuse, with a ValueError, to check the poses of another estimator than the paper's; None is
    one that is not chosen yet.
    """
    if not isinstance(check, bool):
        raise ValueError(f"{name}: expected True or False, got {check!r}")
    if check and estimator not in (None, PAPER):
        raise ValueError(f"{name}: only the estimator {PAPER} has it, got {estimator!r}")
