"""The `msdwarp` command, and the command of a scene script.

Only this room imports cyclopts and rich, after signal handlers are set up.
"""

from .entry_points import main as main, scene_main as scene_main
