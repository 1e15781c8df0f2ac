"""Self-contact: cloth that folds onto itself does not pass through itself.

    p = k max(0, d - |g|),   k = rho omega^2 / 2

with the gap g between two layers and the distance d that the contact keeps between them. The distance is the cloth's
thickness as far as motion shows it, pile and air between the layers included. At d = 0 layers pass through each other.
Driving one layer through the other takes a speed of omega d, 1 m/s for 1 mm (`fit.cloth.contact`). So d first decides
whether layers stop each other. Above that size, d only sets how far apart the layers rest.

The amplitude is d, never negative.

Believe it when layers meet in the takes and pass through each other in the simulation. Cloth that never folds shows
nothing of this effect.

Source: R. Bridson, R. Fedkiw, J. Anderson, "Robust treatment of collisions, contact and friction for cloth animation"
(SIGGRAPH 2002), section 5. Sizes: fabrics are 0.2 to 2 mm thick, towelling and knits up to 6 (KES, at 0.05 kPa).
"""

from dataclasses import dataclass
from typing import ClassVar

from fit.cloth.effect import Effect
from formats.arrays import Floats


@dataclass(frozen=True)
class SelfContact(Effect):
    """Layers that do not pass through each other; the amplitude is the distance at which they are kept apart."""

    name: ClassVar[str] = "self_contact"
    title: ClassVar[str] = "contact of the cloth with itself"
    acts_on: ClassVar[str] = "cloth"
    unit: ClassVar[str] = "m"
    low: ClassVar[float] = 0.0
    high: ClassVar[float] = 0.02  # our choice: about three times the thickest towelling and knits, 6 mm (KES)
    typical: ClassVar[float] = 0.005  # our choice: near the thickest towelling and knits, 6 mm (KES)
    touches: ClassVar[bool] = True
    no_size: ClassVar[float] = 1e-9  # our choice: far thinner than any fabric, so that no layer is stopped

    def contact_thickness(self, amplitude: Floats) -> float:
        """Return the distance at which layers of the cloth are kept apart [m]."""
        return float(amplitude[0])
