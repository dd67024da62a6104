"""Planners side by side on the targets of Xie et al. (2022): the measurements behind Table 1."""

from lasergym.comparison.budget import PulseBudget
from lasergym.comparison.options import CompareOptions
from lasergym.comparison.run import Comparison, Progress, compare

__all__ = ["CompareOptions", "Comparison", "Progress", "PulseBudget", "compare"]
