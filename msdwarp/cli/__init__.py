"""The `msdwarp` command, the command of a scene script, and `run`, which does in Python what it does.

Only this room imports cyclopts and rich, after signal handlers are set up.
"""

from .entry_points import main as main, scene_main as scene_main
from .from_python import run as run
