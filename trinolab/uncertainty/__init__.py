"""The covariance of a fitted pose: `assess` estimates, from the residuals of a fit weighted by the
noise alone, the errors of rig and layout, and unstated faults.
"""

from .assessment import Assessment, LinearFit, assess, refitted

__all__ = ["Assessment", "LinearFit", "assess", "refitted"]
