"""Arguments of the rollout kernel: named bundles of arrays, and the layout of each candidate's numbers.

Each field of a bundle is a parameter of the kernel (`fit.cloth.rollout`), under the same name. `by_name` turns bundles
into keyword arguments, so no order can be wrong. Taichi refuses a missing or unknown parameter. `by_name` refuses a
parameter that is given twice. The kernel puts the same bundles together again and hands them to its functions. Bundles
exist only while the kernel is compiled, so they cost nothing when it runs.

Shapes are of the kernel's arrays. "Lanes" are candidates side by side, always the last axis; a group is one set of
lanes. Arrays over "3 nodes" hold x, y and z of one node after another. Integer arrays that name nodes or samples hold
three times their number, which is where their first coordinate stands.
"""

# No `from __future__ import annotations` here: the kernel's functions read the annotations of these.

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

Array = Any  # NumPy's outside of the kernel, Taichi's inside
Number = Any  # likewise


class Motion(NamedTuple):
    """Positions, velocities and forces of the nodes.

    - `x` [m], (2 groups 3 nodes, lanes): positions of all groups, then their rounding errors
    - `v` [m/s], (groups 3 nodes, lanes)
    - `f` [N], alike: forces, zero when the kernel begins
    - `ahead`: x + bending damping time v, or v itself where friction in bending needs rates
    """

    x: Array
    v: Array
    ahead: Array
    f: Array


class Membrane(NamedTuple):
    """Samples of stretch and shear (`fit.cloth.elements`).

    - `fibre_at`, `fibre_weights`, (n,): nodes and weights of the fibres across, then from `down_entry` on of those down
    - `fibre_area` [m^2], (samples,), the first `fibres_across` of them across
    - `shear_across`, `shear_down`, (4 shears,): fibre samples between which shear is interpolated
    - `between`, (12,): weights of that interpolation
    - `shear_area` [m^2], (shears,)
    """

    fibre_at: Array
    fibre_weights: Array
    down_entry: Number
    fibre_area: Array
    fibres_across: Number
    shear_across: Array
    shear_down: Array
    between: Array
    shear_area: Array


class Strains(NamedTuple):
    """Memory of stretch and shear, each (.. samples of all groups, lanes).

    - `slopes`, `slopes_ahead`, `stress`: three numbers a fibre sample
    - `strains`, `fibre_lags`: one
    - `shear_strains`, `shear_lags`: one a shear sample, then two more where threads cross the elements
    - `lag_kept`, (groups,): share of a viscous lag that remains after a step
    """

    slopes: Array
    slopes_ahead: Array
    strains: Array
    shear_strains: Array
    stress: Array
    fibre_lags: Array
    shear_lags: Array
    lag_kept: Array


class Stencils(NamedTuple):
    """Samples of bending (`fit.cloth.bends`, `fit.cloth.lines`).

    - `bend_first`, (bends + 1,)
    - `bend_nodes`, `bend_weights`, (n,)
    - `bend_kind`, `bend_centre`, (bends,)
    - `bend_counts`: bends of each length
    - `bend_root` [m], (bends,): roots of areas
    - `twist_scales`, `twist_centre`, `twist_root`: the same of mixed second derivatives, (twists,)
    """

    bend_first: Array
    bend_nodes: Array
    bend_weights: Array
    bend_kind: Array
    bend_centre: Array
    bend_root: Array
    bend_counts: Array
    twist_scales: Array
    twist_centre: Array
    twist_root: Array


class Facing(NamedTuple):
    """Normals of the nodes, and the second derivatives that are measured along them.

    - `cells`, (cells, 16): nodes of the elements
    - `basis`, (5, 4): slopes of the shape functions, then the nodes' weights
    - `normal`, (groups 3 nodes, lanes)
    - `faced_area` [m^2], (groups nodes, lanes)
    - `rest_curvature` [1/m], `friction` [N], (groups bends, lanes): curvature at rest and frictional moment per width
    """

    cells: Array
    basis: Array
    normal: Array
    faced_area: Array
    rest_curvature: Array
    friction: Array


class Touch(NamedTuple):
    """Arrays of contact, which `fit.cloth.nearby` describes."""

    contact_whole: Array
    contact_memory: Array
    contact_alone: Array


class Grip(NamedTuple):
    """Held nodes and their handles (`fit.cloth.support`).

    held, (held,): nodes; shares, (held, handles); path [m], (steps of all groups, 3 handles, lanes)
    settle_damping [1/s]: least damping while the cloth settles
    """

    held: Array
    shares: Array
    path: Array
    settle_damping: Number


class Points(NamedTuple):
    """Tracked points, as weighted sums over nodes: point_first, (points + 1,); point_nodes, point_weights, (n, ..)."""

    point_first: Array
    point_nodes: Array
    point_weights: Array


class Pull(NamedTuple):
    """The observer's pull (`fit.observer.residuals`).

    - `pull` [m/s^2], (groups, points, 3, lanes): memory
    - `pull_points`, `pull_weights`, (nodes, 3): how it spreads
    - `targets` [m, m/s], (samples of all groups, 6 points, lanes)
    - `trust` [1], (samples of all groups, points, lanes)
    - `gain` [1/s^2]
    - `damping` [1/s]
    """

    pull: Array
    pull_points: Array
    pull_weights: Array
    targets: Array
    trust: Array
    gain: Number
    damping: Number


class Candidates(NamedTuple):
    """Numbers that differ between candidates.

    material, (groups, `Row`, lanes); amplitude, (groups, components of all effects, lanes)
    inverse_mass [1/kg], added_mass [kg], (groups nodes, lanes)
    """

    material: Array
    amplitude: Array
    inverse_mass: Array
    added_mass: Array


class Clock(NamedTuple):
    """The instants of every group of candidates, step by step.

    time_step [s], (groups,); frame_step, (groups, frames): whole steps to each frame; frame_lag [s], alike: the rest
    counts, (groups, `Counts`)
    """

    time_step: Array
    frame_step: Array
    frame_lag: Array
    counts: Array


class Results(NamedTuple):
    """Arrays that the kernel fills.

    - `seen` [m], (groups, frames, points, 3, lanes): the tracked points
    - `shapes` [m], (groups, frames, nodes, 3, lanes): the nodes; one frame if shapes are not requested
    """

    seen: Array
    shapes: Array


class Row(NamedTuple):
    """Numbers of one candidate's material, in SI.

    Threads may cross the elements. Then a part of the fibres' stiffness as large as shear's acts at the fibres' own
    samples. The rest, `shear_down` and `shear_across`, acts at the samples of shear (`fit.cloth.elements`).
    """

    stretch_down: Number
    stretch_across: Number
    shear: Number
    bending_down: Number
    bending_across: Number
    bending_mixed: Number
    membrane_time: Number
    bending_time: Number
    velocity_damping: Number
    stiffening: Number
    gravity_x: Number
    gravity_y: Number
    gravity_z: Number
    friction_limit: Number
    viscosity_time: Number
    thickness: Number
    density: Number
    shear_down: Number
    shear_across: Number


class Counts(NamedTuple):
    """Integers of one group: frames and steps, and the first rows of its `path` and `targets`.

    A call of the kernel simulates the frames from `first_frame` to before `end_frame`, from the step `first_step` on.
    """

    frames: Number
    first_frame: Number
    end_frame: Number
    first_step: Number
    settle_steps: Number
    first_path: Number
    first_target: Number
    steps_per_target: Number


ROW = Row(*range(len(Row._fields)))  # columns of `Candidates.material`
COUNTS = Counts(*range(len(Counts._fields)))  # columns of `Clock.counts`


class Law(NamedTuple):
    """Parameters of the tension law besides the stiffness: strain rate, stiffening and viscosity (`fit.cloth.forces`).

    delay [1]: damping time over step; stiffening [1]; kept [1], lag_gain [1]: of the viscous lag over a step
    """

    delay: Number
    stiffening: Number
    kept: Number
    lag_gain: Number


class BendLaw(NamedTuple):
    """Parameters of the moment law besides the stiffness: curvature rate and friction (`fit.cloth.moments`).

    bend_time [s]: damping time; friction_limit [N]: largest frictional moment per width; dt [s]: step
    """

    bend_time: Number
    friction_limit: Number
    dt: Number


class Family(NamedTuple):
    """One family of fibres: its samples are start to end, its stencils begin at entry.

    sample_nodes: nodes of a sample, or `fit.cloth.lines.IN_LINES`
    """

    start: Number
    end: Number
    entry: Number
    sample_nodes: int


class Place(NamedTuple):
    """Array offsets of one group: nodes, fibre samples, their slopes, shear samples, bends and twists."""

    home: Number
    first_fibre: Number
    first_slope: Number
    first_shear: Number
    first_crossed: Number
    first_bend: Number
    first_twist: Number


@dataclass(frozen=True, kw_only=True)
class Kind:
    """Compile-time constants of a kernel.

    - `lanes`: number of candidates in parallel
    - `face_forces`: per effect (first column of its amplitude, number of components, force), where force is a
      `ti.func(a0, a1, a2, vx, vy, vz, nx, ny, nz, area) -> (fx, fy, fz)`
    - `fibre_nodes`: nodes of every fibre sample across, and down
    - `bend_lengths`: of the stencils of second derivatives; both may be `fit.cloth.lines.IN_LINES`
    - `handles`: vectors that the held nodes follow, 0 where nothing is held
    - `with_twist`: whether mixed second derivatives come from the slopes across
    - `is_crossed`: whether threads of both families cross the elements
    - `with_bends`: rest curvature and friction in bending
    - `with_added_mass`: inertia of the air along the normal
    - `with_viscosity`: of stretch and shear
    - `with_contact`: the cloth touches itself or bodies
    """

    lanes: int
    face_forces: tuple[tuple[int, int, Any], ...]
    fibre_nodes: tuple[int, int]
    bend_lengths: tuple[int, ...]
    handles: int
    with_twist: bool
    is_crossed: bool
    with_bends: bool
    with_added_mass: bool
    with_viscosity: bool
    with_contact: bool

    @property
    def needs_normals(self) -> bool:
        """Whether any force or moment acts along the normals of the nodes."""
        return self.with_bends or self.with_added_mass or len(self.face_forces) > 0


def by_name(bundles: Sequence[NamedTuple]) -> dict[str, Any]:
    """Return the fields of all bundles as one set of keyword arguments.

    Raises:
        ValueError: two bundles have a field of one name.
    """
    found: dict[str, Any] = {}
    for bundle in bundles:
        fields = bundle._asdict()
        if twice := found.keys() & fields.keys():
            raise ValueError(f"two bundles hold {', '.join(sorted(twice))}")
        found |= fields
    return found
