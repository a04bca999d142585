"""The `msdwarp` command, and what a scene script runs when it is started by itself.

The only importer of cyclopts and rich, which wait until signals are heard.
"""

from .process import main, scene_main

__all__ = ["main", "scene_main"]
