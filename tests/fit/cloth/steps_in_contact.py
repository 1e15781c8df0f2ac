"""Contact as `fit.cloth.contact` and `fit.recordings.bodies` document it, in NumPy: every pair at every step."""

from __future__ import annotations

import numpy as np

from fit.cloth.contact import CONTACT_DAMPING, CONTACT_OMEGA, WINDOW
from tests.fit.cloth.steps import Steps


def traction(gap, n, u, distance, stiffness, viscosity, friction):
    """Force per area on cloth that moves at u beside a surface with the normal n towards it, (pairs, 3)."""
    overlap = np.maximum(distance - gap, 0)
    along = (u * n).sum(1)
    pressure = np.maximum(stiffness * overlap - np.minimum(4 * overlap / distance, 1) * viscosity * along, 0)
    aside = u - along[:, None] * n
    speed = np.linalg.norm(aside, axis=1)
    rub = np.minimum(viscosity, friction * pressure / np.maximum(speed, 1e-9))
    return pressure[:, None] * n - rub[:, None] * aside


def body_distance(p, sizes):
    """Distance of points along a body's axes, (n, 3), from a box with rounded, tapering edges."""
    half, radius, taper = sizes[:3], sizes[3], sizes[4]
    beyond = np.abs(p) - half
    far = np.linalg.norm(np.maximum(beyond, 0), axis=1) + np.minimum(beyond.max(1), 0)
    return (far - radius - taper * np.clip(p[:, 2], -half[2], half[2])) / np.hypot(1, taper)


class StepsInContact(Steps):
    """Steps of cloth that touches itself and the bodies of its model."""

    def __init__(self, model, row, sizes):
        super().__init__(model, row, sizes)
        self.carried = self.dense(model.surface.samples, len(model.mesh.rest))
        self.met = self.leant = 0  # pairs that pushed, over all steps

    def outer(self, x, v, time, is_settling):
        """Forces of contact [N], with bodies as at `time` [s]."""
        contact = self.model.contact
        y, u = self.carried @ x, self.carried @ v
        force = np.zeros_like(y)
        thickness = contact.thickness + self.sizes.get("self_contact", 0.0)
        if thickness > 0:
            self.layers(force, y, u, thickness)
        for body in range(len(contact.bodies)):
            self.lean(force, y, u, body, time, is_settling)
        return self.carried.T @ force

    def law(self, *, layers):
        """Stiffness [N/m^3] and viscosity [N s/m^3] of two layers, or twice as much against a body."""
        scale = (1.0 if layers else 2.0) * CONTACT_OMEGA * self.p["areal_density"]
        return scale * CONTACT_OMEGA / 2, scale * CONTACT_DAMPING

    def layers(self, force, y, u, thickness):
        surface = self.model.surface
        s, q = np.nonzero(surface.may_meet)
        middle = np.full((4, 1), 0.25)
        one, two = (np.array(signs)[:, None] / 2 for signs in ((-1, 1, -1, 1), (-1, -1, 1, 1)))
        corner = y[surface.quads]
        t1, t2 = (corner * one).sum(1), (corner * two).sum(1)
        n = np.cross(t1, t2)
        size = (n**2).sum(1)[:, None]
        d1, d2, n = np.cross(t2, n) / size, np.cross(n, t1) / size, n / np.sqrt(size)
        r = y[s] - corner.mean(1)[q]
        gap, xi, eta = ((r * of[q]).sum(1) for of in (n, d1, d2))
        ends = surface.windows[q].T
        # 1 inside the quad, 1/2 at its side, 0 as far beyond
        felt = 0.5 * surface.area[s] * (np.linalg.norm(r, axis=1) < surface.reach[q])
        for place, after, before in ((xi, ends[2], ends[3]), (eta, ends[0], ends[1])):
            felt = felt * np.clip(np.minimum(after - place, before + place) / (2 * WINDOW - 1), 0, 1)
        near = (felt > 0) & (np.abs(gap) < thickness)
        s, q, xi, eta, gap, felt = (of[near] for of in (s, q, xi, eta, gap, felt))
        share = (middle + one * xi + two * eta).T
        speed = u[s] - np.einsum("pk,pkc->pc", share, u[surface.quads[q]])
        side = np.where(gap < 0, -1.0, 1.0)
        push = felt[:, None] * traction(
            np.abs(gap), side[:, None] * n[q], speed, thickness, *self.law(layers=True), self.model.contact.friction
        )
        np.add.at(force, s, push)
        np.add.at(force, surface.quads[q], -share[..., None] * push[:, None])
        self.met += len(s)

    def lean(self, force, y, u, body, time, is_settling):
        contact = self.model.contact
        sizes, motion = contact.bodies[body].row()[12:], contact.motion
        place = min(time / motion.spacing, len(motion.poses) - 1.0)
        before = min(int(place), len(motion.poses) - 2)
        rate = motion.poses[before + 1, body] - motion.poses[before, body]
        pose = motion.poses[before, body] + (place - before) * rate
        rate = rate * 0 if is_settling else rate / motion.spacing
        p = (y - pose[:3]) @ pose[3:].reshape(3, 3).T
        moved = 1e-7 * np.eye(3)
        slope = np.stack([body_distance(p + d, sizes) - body_distance(p - d, sizes) for d in moved], 1) / 2e-7
        speed = u - rate[:3] - p @ rate[3:].reshape(3, 3)
        stiffness, viscosity = self.law(layers=False)
        push = traction(
            body_distance(p, sizes), slope @ pose[3:].reshape(3, 3), speed, contact.clearance, stiffness, viscosity,
            contact.friction,
        )  # fmt: skip
        force += self.model.surface.area[:, None] * push
        self.leant += int((push != 0).any(1).sum())
