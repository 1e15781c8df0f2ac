"""Description of every effect of the library for the report: one sentence, and the meaning of its size."""

from __future__ import annotations

import math
from dataclasses import dataclass

from markupsafe import Markup

from fit.report.sketches import SKETCHES
from fit.report.templating import NOTHING, piece
from fit.report.text import number


@dataclass(frozen=True)
class Shown:
    """Description of an effect in the report.

    - `sentence`: of the effect's action
    - `size`: the meaning of its amplitude; `{times}` stands for the amplitude over `reference`
    """

    sentence: str
    size: str
    reference: float = 1.0  # in the amplitude's unit: the amplitude itself where nothing else is stated

    def meaning(self, amplitude: float | None) -> str:
        """Return the meaning of an amplitude with its number; without an amplitude, one that needs no number."""
        if amplitude is None:
            return "" if "{times}" in self.size else self.size
        return self.size.format(times=number(abs(amplitude) / self.reference))


def sketch_of(effect: str) -> Markup:
    """Return the sketch of an effect as inline SVG; nothing for an effect that has none."""
    known = SHOWN_EFFECTS.get(effect)
    return piece("effects.html", "sketch", known.sentence, SKETCHES[effect]) if known is not None else NOTHING


def sentence_of(effect: str) -> str:
    """Return the sentence of an effect, empty for one that has none."""
    return SHOWN_EFFECTS[effect].sentence if effect in SHOWN_EFFECTS else ""


def meaning_of(effect: str, amplitude: float | None) -> str:
    """Return the meaning of an effect's amplitude, empty for an effect without one; None: unknown amplitude."""
    is_number = amplitude is None or math.isfinite(amplitude)
    return SHOWN_EFFECTS[effect].meaning(amplitude) if effect in SHOWN_EFFECTS and is_number else ""


SHOWN_EFFECTS: dict[str, Shown] = {
    "shear_stiffness": Shown(
        "The cloth resists a change of the angle between its threads.", "force per width and angle"
    ),
    "bending_hysteresis": Shown(
        "Threads rub on each other as the cloth bends, so that it does not spring back whole.",
        "largest frictional moment per width",
    ),
    "rest_curvature": Shown(
        "The cloth was rolled or folded, and hangs curled.", "curvature at rest, one over the radius"
    ),
    "hem": Shown(
        "Cloth that is sewn up along the bottom makes this edge heavier.", "extra mass per length of the bottom edge"
    ),
    "anisotropy": Shown(
        "Threads down the cloth and threads across it differ in stiffness.",
        "logarithm of stiffness down over stiffness across",
    ),
    "strain_stiffening": Shown(
        "The more the cloth is stretched, the stiffer it becomes.", "growth of the stiffness per unit of strain"
    ),
    "bending_viscosity": Shown(
        "The cloth resists quick bending, so that small folds die away soon.", "viscous moment per width"
    ),
    "stretch_viscosity": Shown(
        "The cloth resists quick stretching, like a damper beside a spring.", "viscosity over stiffness, as a time"
    ),
    "mass_distribution": Shown(
        "The cloth is heavier towards one side or towards the bottom.",
        "slope of the mass per area, as a share of its mean",
    ),
    "self_contact": Shown(
        "Layers that fold onto each other do not pass through one another.", "distance at which layers are kept apart"
    ),
    "hanger_compliance": Shown(
        "Rod or hook bend, so that the held edge lags behind the hanger.", "lag of the held edge per acceleration"
    ),
    "hanger_rotation": Shown(
        "The held edge turns, and the hanger's markers do not show it.", "angle of the held edge against the markers"
    ),
    "attachment_offset": Shown(
        "The cloth hangs from another place of the hanger than the rig states.", "distance from the stated place"
    ),
    "clip_slip": Shown("Once in a take the cloth slips a little out of a clip.", "distance that the cloth slips"),
    "clip_slack": Shown(
        "The clips are nearer to each other than the rig states, so that the top edge sags.",
        "length of cloth too much between the clips",
    ),
    "air_drag": Shown(
        "Still air slows the cloth, with the square of its speed.",
        "drag coefficient in still air, {times} times that of a flat plate (1.2)",
        reference=1.2,
    ),
    "added_mass": Shown(
        "Air that moves along with the cloth makes it more inert.",
        "mass of the air that moves along, per area of cloth",
    ),
    "draught": Shown("The air of the room moves steadily and pushes the cloth.", "speed of the room's air"),
    "air_lift": Shown(
        "Air that flows along the cloth presses it sideways where it leans.",
        "lift coefficient, {times} times that of a thin plate in ideal flow (6.28)",
        reference=2 * math.pi,
    ),
    "time_offset": Shown("The points carry later time stamps than the hanger's markers.", "delay of the points"),
    "gravity_tilt": Shown(
        "The rig states a direction of gravity that is not the true one.", "angle between stated and true gravity"
    ),
    "depth_scale": Shown(
        "The sensor reads every distance too long or too short by the same share.",
        "share by which distances are read too long",
    ),
    "filter_lag": Shown("The tracker smooths its points in time and so runs behind.", "time constant of the smoothing"),
    "corner_erosion": Shown(
        "The silhouette loses its corners or its border, so that points appear too far inside.",
        "distance that points appear too far inside",
    ),
    "clock_drift": Shown(
        "The clock of the points runs at another rate than that of the markers.",
        "share by which the points' clock is slower",
    ),
    "tracker_smoothing": Shown(
        "The tracker smooths wrinkles out of its points.", "share of each wrinkle that is smoothed out"
    ),
    "sliding_points": Shown(
        "A grid is laid evenly over what the camera sees, so that its points slide along the cloth.",
        "share of the sliding that the grid's length shows",
    ),
    "eroded_outline": Shown(
        "The far border of the silhouette is eroded, the more the further the cloth leans.",
        "length lost at the border per unit of lean",
    ),
    "frame_timing": Shown(
        "Stamps say when frames were published, which is later where processing took longer.",
        "share of the interval before a frame by which its stamp is late",
    ),
}
