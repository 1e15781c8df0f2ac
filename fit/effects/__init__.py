"""Library of the unmodelled effects that a diagnosis tests; each effect is one file and one line in `LIBRARY`."""

from fit.cloth.effect import Effect
from fit.effects.added_mass import AddedMass
from fit.effects.air_drag import AirDrag
from fit.effects.air_lift import AirLift
from fit.effects.anisotropy import Anisotropy
from fit.effects.attachment_offset import AttachmentOffset
from fit.effects.bending_hysteresis import BendingHysteresis
from fit.effects.bending_viscosity import BendingViscosity
from fit.effects.clip_slack import ClipSlack
from fit.effects.clip_slip import ClipSlip
from fit.effects.clock_drift import ClockDrift
from fit.effects.corner_erosion import CornerErosion
from fit.effects.depth_scale import DepthScale
from fit.effects.draught import Draught
from fit.effects.eroded_outline import ErodedOutline
from fit.effects.filter_lag import FilterLag
from fit.effects.frame_timing import FrameTiming
from fit.effects.gravity_tilt import GravityTilt
from fit.effects.hanger_compliance import HangerCompliance
from fit.effects.hanger_rotation import HangerRotation
from fit.effects.hem import Hem
from fit.effects.mass_distribution import MassDistribution
from fit.effects.rest_curvature import RestCurvature
from fit.effects.self_contact import SelfContact
from fit.effects.shear_stiffness import ShearStiffness
from fit.effects.sliding_points import SlidingPoints
from fit.effects.strain_stiffening import StrainStiffening
from fit.effects.stretch_viscosity import StretchViscosity
from fit.effects.time_offset import TimeOffset
from fit.effects.tracker_smoothing import TrackerSmoothing
from fit.errors import FitError, unknown_name

LIBRARY: tuple[Effect, ...] = (
    ShearStiffness(),
    BendingHysteresis(),
    RestCurvature(),
    Hem(),
    Anisotropy(),
    StrainStiffening(),
    BendingViscosity(),
    StretchViscosity(),
    MassDistribution(),
    SelfContact(),
    HangerCompliance(),
    HangerRotation(),
    AttachmentOffset(),
    ClipSlip(),
    ClipSlack(),
    AirDrag(),
    AddedMass(),
    Draught(),
    AirLift(),
    TimeOffset(),
    GravityTilt(),
    DepthScale(),
    FilterLag(),
    CornerErosion(),
    ClockDrift(),
    TrackerSmoothing(),
    SlidingPoints(),
    ErodedOutline(),
    FrameTiming(),
)


def library_without(names: list[str]) -> tuple[Effect, ...]:
    """Return the library without the effects of these names.

    Raises:
        FitError: a name is not in the library, or nothing is left.
    """
    left_out = find_effects(names, where="--without")
    left = tuple(effect for effect in LIBRARY if effect not in left_out)
    if not left:
        raise FitError("no effect is left in the library", where="--without", advice="leave out fewer")
    return left


# Words by which people may look for an effect, beside its name and title.
SOUGHT_AS = {
    "air_drag": "resistance", "draught": "wind breeze", "time_offset": "delay latency", "filter_lag": "smoothing",
    "bending_hysteresis": "damping",
}  # fmt: skip


def find_effects(names: list[str], where: str | None = None) -> tuple[Effect, ...]:
    """Return the effects of these names; where: the option that names them, for errors.

    Raises:
        FitError: a name is not in the library.
    """
    known = {effect.name: effect for effect in LIBRARY}
    for name in names:
        if name not in known:
            titles = {effect.name: f"{effect.title} {SOUGHT_AS.get(effect.name, '')}" for effect in LIBRARY}
            raise unknown_name("effect", name, sorted(known), where=where, titles=titles)
    return tuple(known[name] for name in names)
