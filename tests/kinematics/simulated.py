"""A model in MuJoCo, moved so slowly that it rests at every step."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any

import numpy as np

# It has no annotations.
mujoco: Any = importlib.import_module("mujoco")

AT_REST = 1e-5
"""Coordinates that change by less than this per s (rad or m) are at rest."""

PATIENCE = 5000
"""Steps in which everything should come to rest."""

_warnings: list[str] = []
# Otherwise MuJoCo writes a file into the working directory for them. It cannot bear an exception.
mujoco.set_mju_user_warning(_warnings.append)


class Simulated:
    """A model, where it is now; lengths in mm."""

    def __init__(self, text: str) -> None:
        self.model = mujoco.MjModel.from_xml_string(text)
        self.data = mujoco.MjData(self.model)
        mujoco.mj_forward(self.model, self.data)
        self._sites: dict[str, list[int]] = {}
        for index in range(self.model.nsite):
            joint, _, body = self.model.site(index).name.partition(" on ")
            if body:
                self._sites.setdefault(joint, []).append(index)

    def start(self, key: str) -> None:
        """Go to a keyframe."""
        mujoco.mj_resetDataKeyframe(self.model, self.data, self.model.key(key).id)

    def run(self, time: float) -> None:
        """Go on for a time, s."""
        mujoco.mj_step(self.model, self.data, round(time / self.model.opt.timestep))
        assert not _warnings, _warnings.pop()

    def settle(self, controls: Sequence[float] | np.ndarray) -> None:
        """Tell the motors where to go, and wait until everything rests."""
        self.data.ctrl[:] = controls
        for _ in range(PATIENCE // 20):
            self.run(20 * self.model.opt.timestep)
            if np.abs(self.data.qvel).max() < AT_REST:
                # Places and forces are those before the last step until they are asked for again.
                return self.look(controls)
        raise AssertionError("it does not come to rest")

    def look(self, controls: Sequence[float] | np.ndarray) -> None:
        """Tell the motors where to go, and compute all forces at that moment."""
        self.data.ctrl[:] = controls
        mujoco.mj_forward(self.model, self.data)

    def places(self, joint: str) -> np.ndarray:
        """The place of a joint on each of its bodies."""
        return 1e3 * self.data.site_xpos[self._sites[joint]]

    def gap(self) -> float:
        """How far the places of one joint are apart at most."""
        return max(float(np.ptp(self.places(joint), axis=0).max()) for joint in self._sites)

    def coordinate(self, joint: str) -> float:
        """Of a joint in MuJoCo's sense, rad or m."""
        return float(self.data.joint(joint).qpos[0])

    def push(self, geom: str) -> float:
        """The normal forces on a geom, N."""
        total, force = 0.0, np.zeros(6)
        for index, contact in enumerate(self.data.contact):
            if self.model.geom(geom).id in contact.geom:
                mujoco.mj_contactForce(self.model, self.data, index, force)
                total += float(force[0])
        return total

    def freedoms(self) -> int:
        """Coordinates less the constraints on them."""
        stored, self.model.opt.jacobian = self.model.opt.jacobian, mujoco.mjtJacobian.mjJAC_DENSE
        mujoco.mj_forward(self.model, self.data)
        self.model.opt.jacobian = stored
        matrix = self.data.efc_J.reshape(self.data.nefc, self.model.nv)
        rank = int(np.linalg.matrix_rank(matrix)) if self.data.nefc else 0
        return self.model.nv - rank
