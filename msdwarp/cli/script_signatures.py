"""Trust: permission to run the scripts that files name.

A file may come from anyone. So a script named in a file runs without permission only if the file has a valid seal,
made with a key that only this user has. A seal proves that this user ran the script, unchanged, at this path.
"""

import hashlib
import hmac
import os
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter

from .scene_files import Origin, find_scene


@Parameter(name="*")
@dataclass(frozen=True, kw_only=True)
class Script:
    """The user's permission to run a script."""

    scene: str | None = None
    """Use this scene (a name or a script's path) instead of the one that the file names."""
    trust: Annotated[bool, Parameter(negative=())] = False
    """Run the script that the file names, even if it has changed, was moved, or was never run here."""

    @property
    def requested(self) -> bool:
        """Whether the user requests a script, even if the file suffices."""
        return self.trust or self.scene is not None

    def found(self, place: str, attributes: Mapping[str, Any]) -> Origin:
        """Return the origin of the scene to build, by name or path; raise ValueError if its script may not run."""
        if self.scene is not None or self.trust:
            return find_scene(self.scene or place)

        def check(digest: str) -> None:
            if why := reason_for_distrust(place, digest, attributes.get("script")):
                raise ValueError(
                    f"scene is {place!r}, a script, and {why}; allow it with --trust, or name another by "
                    "--scene PATH"
                )

        return find_scene(place, check)


UNTRUSTED = Script()
"""No permission: a script named in a file runs only if this user ran it before."""


def script_as_stored(place: str, digest: str | None) -> dict[str, dict[str, str | None]]:
    """Return the attributes to store for a script with this SHA-256; none for a scene that comes with msdwarp."""
    return {} if digest is None else {"script": {"sha256": digest, "seal": _seal(place, digest)}}


def reason_for_distrust(place: str, digest: str, stored: Any) -> str | None:
    """Return why a script with this SHA-256 may not run without permission; None if it may run."""
    if not isinstance(stored, Mapping) or not isinstance(stored.get("sha256"), str):
        return "the file does not say what was in it"
    if not Path(place).is_absolute():
        return "the file does not say in which folder"
    if stored["sha256"] != digest:
        return "it has changed since the run began"
    seal = _seal(place, digest)
    given = str(stored.get("seal"))
    if seal is None or not hmac.compare_digest(seal.encode(), given.encode()):
        return "the run was not made here by you"
    return None


def _seal(place: str, digest: str) -> str | None:
    """Return this user's seal of a script's path and digest; None if the user's key cannot be stored."""
    key = _key()
    return None if key is None else hmac.new(key, f"{digest} {place}".encode(), hashlib.sha256).hexdigest()


def _key() -> bytes | None:
    """Return this user's key, which is made when first needed; None if it cannot be stored."""
    try:
        state = os.environ.get("XDG_STATE_HOME") or str(Path.home() / ".local" / "state")
        path = Path(state) / "msdwarp" / "key"
        if not path.exists():
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            beside = path.with_name(f"key-{secrets.token_hex(8)}")
            beside.touch(mode=0o600)
            try:
                beside.write_bytes(secrets.token_bytes(32))
                os.link(beside, path)  # atomic, and succeeds in one process only
            except FileExistsError:
                pass
            finally:
                beside.unlink()
        key = path.read_bytes()
    except (OSError, RuntimeError):  # no home folder, or another user's
        return None
    return key if len(key) == 32 else None
