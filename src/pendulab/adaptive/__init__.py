"""Filters that learn Q or R from what they see.

A scheme wraps a filter and goes where a filter goes: ``track(..., method=innovation_Q(ekf, window=40))``. It
keeps no state of its own: `begin` gives a `Memory`, `update` returns the next one, and the track records the
covariances that were used in every step.

What is learned is a covariance by construction: a mean of squares, a squared gain, an inverse
Wishart mean, or a multiple within stated bounds. Nothing is repaired by adding a small number to a
diagonal.

At lag 0 the innovations show one matrix, S = H P⁻ Hᵀ + R, and a larger Q explains a larger S as well as a
larger R does. So the schemes that look at lag 0 learn either Q or R, and take the other for right. What tells
the two apart is how innovations hang together in time: `likelihood_scales` uses it, and learns both.
"""

from .by_likelihood import likelihood_scales
from .fading import sage_husa_R, variational_R
from .scheme import Memory, Scheme, Step, Window
from .windowed import innovation_Q, innovation_R, nis_scaled_Q, residual_R

__all__ = [
    "Memory",
    "Scheme",
    "Step",
    "Window",
    "innovation_Q",
    "innovation_R",
    "likelihood_scales",
    "nis_scaled_Q",
    "residual_R",
    "sage_husa_R",
    "variational_R",
]
