"""Loads: what acts on particles beside a route's forces, each a piece that a scene's kernels are composed with."""

from .attachments import attachments
from .drives import driven
from .forces import applied_force, function_force
from .ties import tie_force
from .work import measured, sum_work, work

__all__ = ["applied_force", "attachments", "driven", "function_force", "measured", "sum_work", "tie_force", "work"]
