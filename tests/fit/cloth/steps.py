"""The documented steps of the cloth in NumPy, in double precision: samples as matrices, one candidate at a time."""

from __future__ import annotations

import numpy as np

from fit.cloth import material as mat
from fit.cloth import spectral
from fit.cloth.bends import COLUMN_BEND, ROW_BEND
from fit.cloth.effect import Effect
from fit.cloth.material import REFERENCE_CURVATURE, RELAXATION_TIME
from formats.nature import AIR_DENSITY

PLATE = 1.2  # drag coefficient of a draught's plate (`fit.effects.draught`)
PULLED = 0.2  # of the settling (`fit.cloth.support`)
SETTLE_OMEGA = 2 * np.pi * 8.0  # 1/s (`fit.cloth.rollout`)


def pressing(u, n):
    """Duchemin's pressure of air at u on plates with normals n, over half its density times area and coefficient."""
    along, square = (u * n).sum(1), (u**2).sum(1)
    return 2 * np.sqrt(square) * along * square / (square + along**2 + 1e-30)


class Steps:
    """One candidate's cloth; `sizes` gives the amplitudes of effects by their names."""

    def __init__(self, model, row, sizes):
        mesh, p = model.mesh, dict(zip(mat.MATERIAL_NAMES, row, strict=True))
        self.model, self.mesh, self.p, self.sizes = model, mesh, p, sizes
        nodes, count = len(mesh.rest), len(mesh.fibres.area)
        self.fibres, self.bends = (self.dense(of.stencils, nodes) for of in (mesh.fibres, mesh.bends))
        at_across, at_down = mesh.shear_across, mesh.shear_down
        self.at_shear = [np.zeros((len(at), count)) for at in (at_across, at_down)]
        for matrix, at, weights in zip(
            self.at_shear, (at_across, at_down), np.split(mesh.shear_weights, 2, 1), strict=True
        ):
            np.add.at(matrix, (np.arange(len(at))[:, None], at), weights)
        if len(mesh.bends.twist_weights):
            twists = np.zeros((len(at_across), count))
            np.add.at(twists, (np.arange(len(at_across))[:, None], at_across), mesh.bends.twist_weights)
            self.bends = np.concatenate([self.bends, twists @ self.fibres])
        ratio = np.exp(p["stretch_ratio"] / 2)
        across, down = p["stretch_stiffness"] / ratio, p["stretch_stiffness"] * ratio
        self.apart = [max(k - p["shear_stiffness"], 0.0) if mesh.is_crossed else 0.0 for k in (across, down)]
        is_across = np.arange(count) < mesh.fibres_across
        self.stretch = mesh.fibres.area * np.where(is_across, across - self.apart[0], down - self.apart[1])
        ratio, kind = np.exp(p["bending_ratio"] / 2), mesh.bends.kind
        self.bending = p["bending_stiffness"] * np.where(
            kind == ROW_BEND, 1 / ratio, np.where(kind == COLUMN_BEND, ratio, 1.0)
        )
        curl = sizes.get("rest_curvature", (0.0, 0.0))
        self.curl = np.where(kind == COLUMN_BEND, curl[0], np.where(kind == ROW_BEND, curl[1], 0.0))
        self.mass = p["areal_density"] * mesh.node_area
        middle, half = (mesh.rest.max(0) + mesh.rest.min(0)) / 2, np.ptp(mesh.rest, axis=0) / 2
        inside = np.prod(np.clip(1 - ((mesh.rest - middle) / half) ** 2, 0, 1), axis=1)
        self.air = sizes.get("added_mass", 0.0) * mesh.node_area * np.sqrt(inside)
        x, y = np.sin(p["tilt_x"]), np.sin(p["tilt_y"])
        g = model.support.gravity * np.exp(p["gravity_log"])
        self.gravity = g * np.array([x, y, -np.sqrt(1 - x**2 - y**2)])
        self.friction = np.zeros(len(kind))
        self.memory = {}

    @staticmethod
    def dense(stencils, nodes):
        matrix = np.zeros((len(stencils), nodes))
        np.add.at(matrix, (stencils.rows(), stencils.nodes), stencils.weights[:, 0])
        return matrix

    def late(self, name, strain, dt):
        """Viscous part that is added to a strain; there is no step before the first, hence no rate."""
        last, lag = self.memory.get(name, (strain, 0.0))
        change, kept = strain - last, np.exp(-dt / RELAXATION_TIME)
        lag = kept * lag + self.p["viscosity_time"] * (1 - kept) / dt * change
        self.memory[name] = strain, lag
        return self.p["membrane_damping_time"] / dt * change + lag

    def tension(self, name, u, dt):
        strain = ((u**2).sum(1) - 1) / 2
        return (strain * (1 + self.p["stiffening"] * np.abs(strain)) + self.late(name, strain, dt))[:, None] * u

    def membrane(self, x, dt):
        slopes = self.fibres @ x
        stress = self.stretch[:, None] * self.tension("fibres", slopes, dt)
        u, w = (matrix @ slopes for matrix in self.at_shear)
        strain = (u * w).sum(1)
        area = self.mesh.shear_area[:, None]
        shear = self.p["shear_stiffness"] * area * (strain + self.late("shear", strain, dt))[:, None]
        at_u, at_w = shear * w, shear * u
        if self.mesh.is_crossed:
            at_u = at_u + self.apart[0] * area * self.tension("across", u, dt)
            at_w = at_w + self.apart[1] * area * self.tension("down", w, dt)
        return -self.fibres.T @ (stress + self.at_shear[0].T @ at_u + self.at_shear[1].T @ at_w)

    def bent(self, x, v, n, dt):
        kappa, rate, root = self.bends @ x, self.bends @ v, np.sqrt(self.mesh.bends.area)
        n = n[self.mesh.bends.centre]
        most = self.sizes.get("bending_hysteresis", 0.0)
        change = (rate * n).sum(1) / root * dt
        goal = np.where(change > 0, most, -most)
        self.friction = goal + (self.friction - goal) * np.exp(-np.abs(change) / REFERENCE_CURVATURE)
        moment = self.bending[:, None] * (kappa + self.p["bending_damping_time"] * rate)
        moment += (root * (self.friction - self.bending * self.curl))[:, None] * n
        return -self.bends.T @ moment

    def normals(self, x):
        """Unit normals, and the area that each node faces [m^2]."""
        n, of = np.zeros_like(x), spectral.slopes(spectral.LOBATTO_NODES)
        share = np.outer(spectral.LOBATTO_WEIGHTS, spectral.LOBATTO_WEIGHTS)
        for cell in self.mesh.cells.reshape(-1, 4, 4):
            right, down = np.einsum("ck,rkd->rcd", of, x[cell]), np.einsum("rk,kcd->rcd", of, x[cell])
            np.add.at(n, cell, share[..., None] * np.cross(down, right))
        area = np.linalg.norm(n, axis=1)
        return n / area[:, None], area

    def air_forces(self, v, n, area):
        along = (v * n).sum(1)
        size = -self.sizes.get("air_drag", 0.0) * np.abs(along) * along
        wind = np.array([*self.sizes.get("draught", (0.0, 0.0)), 0.0])
        size -= PLATE * (pressing(v - wind, n) - pressing(v, n))
        return (0.5 * AIR_DENSITY * area * size)[:, None] * n

    def outer(self, x, v, time, is_settling):
        """Further forces [N], of cloth that touches something."""
        return np.zeros_like(x)

    def pull(self, x, v, omega, time, is_settling):
        """Acceleration towards the targets, interpolated between the solver's own instants."""
        targets, trust, every = self.model.observer_targets(self.octaves)
        place = time / (every * self.dt)
        k = int(place + 1e-6)
        part = place - k
        aim, believed = ((1 - part) * of[k] + part * of[k + 1] for of in (targets, trust))
        seen = self.dense(self.mesh.points, len(x))
        speed = 0.0 if is_settling else aim[:, 3:]
        pull = believed[:, None] * (omega**2 * (aim[:, :3] - seen @ x) + 2 * omega * (speed - seen @ v))
        return np.einsum("np,npc->nc", self.mesh.pull_weights, pull[self.mesh.pull_points])

    def run(self, start, octaves, omega=0.0):
        """Positions at every frame, (frames, nodes, 3), and the last forces [N]."""
        model, support = self.model, self.model.support
        self.octaves, self.dt = octaves, model.step(octaves)
        dt, x, v, row, shapes = self.dt, start.copy(), np.zeros_like(start), 0, []
        settling = round(support.settle_time / dt)
        force = np.zeros_like(x)
        for step in range(-settling, int(model.recording.time[-1] / dt + 1e-9) + 1):
            while row < len(model.recording.time) and int(model.recording.time[row] / dt + 1e-9) == max(step, -1):
                shapes.append(x + (model.recording.time[row] - step * dt) * v)
                row += 1
            if row == len(model.recording.time):
                break
            is_settling, now = step < 0, max(step, 0)
            n, area = self.normals(x)
            force = self.membrane(x, dt) + self.bent(x, v, n, dt) + self.air_forces(v, n, area)
            force = force + self.outer(x, v, now * dt, is_settling)
            a = self.gravity + force / self.mass[:, None]
            along = (a * n).sum(1) * self.air / (self.mass + self.air)
            a = a - along[:, None] * n
            pulling = omega
            if is_settling:
                pulling = SETTLE_OMEGA if step < int(settling * (PULLED - 1.0)) else 0.0
            if pulling:
                a = a + self.pull(x, v, pulling, now * dt, is_settling)
            c = max(self.p["velocity_damping"], support.settle_damping if is_settling else 0.0)
            v = ((1 - c * dt / 2) * v + dt * a) / (1 + c * dt / 2)
            x = x + dt * v
            before, here = support.path(np.array([now, max(step + 1, 0)]) * dt).reshape(2, -1, 3)
            x[support.nodes], v[support.nodes] = support.shares @ here, support.shares @ (here - before) / dt
        return np.array(shapes), force


def amplitudes_by_name(effects: tuple[Effect, ...], row):
    """Amplitudes of a row by the effects' names: a number, or a tuple for several components."""
    found, at = {}, 0
    for effect in effects:
        some = tuple(map(float, row[at : at + len(effect.components)]))
        found[effect.name] = some if len(some) > 1 else some[0]
        at += len(some)
    return found
