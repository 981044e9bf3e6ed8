"""How far a fitted pose may be off: `assess` fits once more, by marginal least squares, all that a
fit by the noise leaves out: the errors of rig and layout, and faults that nobody states.
"""

from .assessment import Assessment, LinearFit, assess, refitted

__all__ = ["Assessment", "LinearFit", "assess", "refitted"]
