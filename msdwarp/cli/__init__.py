"""The `msdwarp` command, and the command of a scene script.

The only importer of cyclopts and rich, which wait until signals are heard.
"""

from .process import main as main, scene_main as scene_main
