"""The `msdwarp` command, and the command of a scene script.

The only importer of cyclopts and rich; they are imported after signals are handled.
"""

from .process import main as main, scene_main as scene_main
