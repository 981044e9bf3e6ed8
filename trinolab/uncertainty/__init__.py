"""The covariance of a fitted pose: `assess` estimates, from what a fit by the noise leaves over, the
errors of rig and layout, and faults that nobody states.
"""

from .assessment import Assessment, LinearFit, assess, refitted

__all__ = ["Assessment", "LinearFit", "assess", "refitted"]
