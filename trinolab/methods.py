"""The names of the estimators, in a module that loads nothing: the command line knows them before
it computes.
"""

__all__ = ["BEST", "ESTIMATORS", "METHODS", "estimator_of"]

ESTIMATORS = ("paper", "paper_checked", "weighted", "reprojection", "patches", "outline")
BEST = "patches"  # the most accurate that keeps up with 30 frames a second
# what --method may name -> the estimator
METHODS = {**{name: name for name in ESTIMATORS}, "best": BEST}


def estimator_of(method: str) -> str:
    """The estimator that ``--method`` names. Raises ValueError for another word."""
    if method not in METHODS:
        raise ValueError(f"method: expected one of {', '.join(METHODS)}, got {method!r}")
    return METHODS[method]
