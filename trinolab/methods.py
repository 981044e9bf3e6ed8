"""The names of the estimators, in a module that loads nothing: the command line knows them before
it computes.
"""

__all__ = ["BEST", "DEFAULT", "ESTIMATORS", "METHODS", "PAPER", "estimator_of"]

ESTIMATORS = ("paper", "paper_checked", "weighted", "reprojection", "patches", "outline")
PAPER = "paper"  # Eq. 20-24: what the functions of the chain take unless they are told otherwise
BEST = "patches"  # the most accurate that keeps up with 30 frames a second
# what --method may name -> the estimator
METHODS = {**{name: name for name in ESTIMATORS}, "best": BEST}
# Whoever asks for a pose and names no estimator gets this one: ``trinolab.measure``,
# ``trinolab.track`` and each command.
DEFAULT = "best"


def estimator_of(method: str, name: str = "method") -> str:
    """The estimator that ``--method`` names. Raises ValueError, with the argument's name, for
    another word.
    """
    if not isinstance(method, str) or method not in METHODS:
        raise ValueError(f"{name}: expected one of {', '.join(METHODS)}, got {method!r}")
    return METHODS[method]
