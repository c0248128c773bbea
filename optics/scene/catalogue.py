"""Cameras that are sold: what ``model`` in a scene file stands for."""

from __future__ import annotations

import difflib
import functools
import tomllib
from collections.abc import Mapping
from importlib.resources import files
from typing import Any

EVIDENCE = ("stated", "verified", "assumed")
"""Keys of an entry that are none of ``[camera]``."""


@functools.cache
def camera_catalogue() -> dict[str, dict[str, Any]]:
    """Every camera of the catalogue by its name: keys of ``[camera]``, and what is known of it.

    Example:
        >>> camera_catalogue()["raspberry-pi-2"]["format"]["pixels"]
        [3280, 2464]
    """
    text = (files("optics.scene") / "cameras.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


def filled_in(camera: Any) -> Any:
    """A file's ``[camera]`` with the keys of its model that it does not give itself.

    Raises:
        ValueError: no camera has that name.
    """
    if not isinstance(camera, dict) or not isinstance(camera.get("model"), str):
        return camera
    name, known = camera["model"], camera_catalogue()
    if name not in known:
        close = difflib.get_close_matches(name, known, n=1)
        hint = f"did you mean '{close[0]}'?" if close else f"there are: {', '.join(known)}"
        raise ValueError(f"no camera of the catalogue is named '{name}'; {hint}")
    entry = {key: value for key, value in known[name].items() if key not in EVIDENCE}
    if isinstance(camera.get("format"), dict):
        entry["format"] = {**entry["format"], **camera["format"]}
        camera = {key: value for key, value in camera.items() if key != "format"}
    return {**entry, **camera}


def assumed_of(camera: Mapping[str, Any]) -> dict[str, Any]:
    """What a file's ``[camera]`` takes from its model though no source states it, by its keys.

    Example:
        >>> assumed_of({"model": "ov6948", "projection": "equisolid"})
        {'fov_axis': 'diagonal'}
    """
    entry = camera_catalogue()[camera["model"]] if "model" in camera else {}
    return {key: entry[key] for key in entry.get("assumed", ()) if key not in camera}
