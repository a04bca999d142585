"""The `msdwarp` command, and what a scene script runs when it is started by itself.

The only importer of cyclopts and rich, which wait until signals are heard.
"""

from .process import main as main, scene_main as scene_main
