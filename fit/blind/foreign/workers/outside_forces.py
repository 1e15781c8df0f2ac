"""External forces on a sheet, for engines without them: air, and effects outside the library.

The laws are those of our generator; `fit.blind.kernel` has equations and sources. They are a plate coefficient by angle
of attack with skin friction along the cloth, lift, and a draught. Effects outside the library are a wake with memory, a
weight on a string, a thread to the room and a magnet. The module runs in the engine's Python: NumPy only.
"""

import numpy as np

BLIND_AIR = 1.2041  # kg/m^3, dry air at 20 degC; formats.nature has 1.204; existing cases keep this value
SKIN_FRICTION = 0.02  # of the normal coefficient, along the cloth, as `fit.blind.kernel`
DRAUGHT = 1.2  # plate coefficient of a draught; as the typical one of `fit.effects.air_drag`
BOB_STIFFNESS = 25.0  # N/m of the string that a corner weight hangs on, as `fit.blind.kernel`


def plate(speed, along_normal, coefficient):
    """Return the normal force per area [Pa], (faces,), of plates; speed and normal component of the flow [m/s]."""
    attack = np.abs(along_normal) / (speed + 1e-12)
    return 0.5 * BLIND_AIR * coefficient * speed * along_normal * 0.505 / (0.222 * attack + 0.283)


class OutsideForces:
    """The forces of one take."""

    def __init__(self, numbers, triangles, spot, start, dt):
        """Prepare the forces.

        - `numbers` [SI]: by the names of `fit.blind.engine.Engine.numbers`
        - `triangles`, (faces, 3): nodes of each triangle
        - `spot`, (nodes,): shares of the magnet's pull
        - `start` [m], (nodes, 3): the sheet at the first step
        - `dt` [s]: time step
        """
        self.p, self.triangles, self.spot, self.dt = numbers, triangles, spot, dt
        self.wind = np.array([numbers["wind_x"], numbers["wind_y"], numbers["wind_z"]])
        self.has_air = bool(numbers["drag"] or numbers["lift"] or numbers["wake"] or self.wind.any())
        self.has_spots = bool(numbers["bob_mass"] or numbers["thread"] or numbers["magnet"])
        self.lagging = np.zeros(len(triangles))
        self.gravity = np.array([numbers["gravity_x"], numbers["gravity_y"], numbers["gravity_z"]])
        self.bob = start[int(numbers["bob_node"])] - [0.0, 0.0, numbers["bob_length"]]
        self.bob_speed = np.zeros(3)

    @property
    def are_there(self):
        """Whether any of these forces acts."""
        return self.has_air or self.has_spots

    def at(self, now, x, v):
        """Return the forces [N], (nodes, 3), at a time [s] since the take's start, and advance states with memory.

        x [m], v [m/s], (nodes, 3): positions and velocities
        """
        force = np.zeros_like(x)
        if self.has_air:
            self._add_air(now, x, v, force)
        if self.has_spots:
            self._add_spots(x, force)
        return force

    def _add_air(self, now, x, v, force):
        p, (i, j, k) = self.p, self.triangles.T
        cross = np.cross(x[j] - x[i], x[k] - x[i])
        doubled = np.sqrt((cross**2).sum(1)) + 1e-15
        n = cross / doubled[:, None]
        vc = (v[i] + v[j] + v[k]) / 3
        vn, speed = (vc * n).sum(1), np.sqrt((vc**2).sum(1))
        along = vc - vn[:, None] * n
        normal = -plate(speed, vn, p["drag"])
        normal -= 0.5 * BLIND_AIR * p["lift"] * vn * (along**2).sum(1) / (speed + 1e-12)
        if self.wind.any():  # drag in moving air minus drag in still air, which is a separate effect
            # gusts of 15 % at 1.9 rad/s, as `fit.blind.kernel`
            flow = self.wind * (1 + 0.15 * np.sin(1.9 * now + p["gust_phase"])) - vc
            normal += plate(np.sqrt((flow**2).sum(1)), (flow * n).sum(1), DRAUGHT) + plate(speed, vn, DRAUGHT)
        if p["wake"]:
            self.lagging += (vn - self.lagging) * self.dt / p["wake_time"]
            normal -= p["wake"] * (vn - self.lagging)
        friction = -0.5 * BLIND_AIR * SKIN_FRICTION * p["drag"] * speed[:, None] * along
        share = (normal[:, None] * n + friction) * (doubled / 6)[:, None]
        for c in range(3):
            force[:, c] += np.bincount(self.triangles.ravel(), np.repeat(share[:, c], 3), len(x))

    def _add_spots(self, x, force):
        p = self.p
        if p["bob_mass"]:
            node = int(p["bob_node"])
            apart = self.bob - x[node]
            length = np.linalg.norm(apart) + 1e-9
            pull = max(0.0, BOB_STIFFNESS * (length - p["bob_length"])) / length * apart
            self.bob_speed += self.dt * (self.gravity - pull / p["bob_mass"])
            self.bob = self.bob + self.dt * self.bob_speed
            force[node] += pull
        if p["thread"]:
            node = int(p["thread_node"])
            apart = np.array([p["thread_x"], p["thread_y"], p["thread_z"]]) - x[node]
            length = np.linalg.norm(apart) + 1e-9
            force[node] += p["thread"] * max(0.0, length - p["thread_length"]) / length * apart
        if p["magnet"]:
            pole = np.array([p["magnet_x"], p["magnet_y"], p["magnet_z"]])
            apart = (pole - x) / p["magnet_reach"]
            near = 1 + (apart**2).sum(1)
            force += (p["magnet"] * self.spot / near**2)[:, None] * apart
