"""Export of a fabric's physics as U3M 1.1: weight in the common part, SI quantities and intervals under `custom`.

The common part has thickness [mm], weight [g/m^2], and the raw forces of one fabric analyser. Thickness is null, as
motion does not identify it. Forces are omitted, as motion does not measure them. `custom.hangtime` holds everything
else. Source: Vizoo, "U3M", version 1.1, `u3m_schema.json`.
"""

from __future__ import annotations

import hashlib
import json
import uuid
from typing import Any

import msgspec

from fit.export.about import caution_lines, provenance, quantity_record
from fit.export.fabric import Fabric
from formats.fit_records import FitResult


def u3m(result: FitResult, fabric: Fabric) -> bytes:
    """Return a `.u3m` file; its identity depends on the fit only, not on the time of writing."""
    digest = hashlib.sha256(msgspec.json.encode(result)).digest()
    takes = ", ".join(result.take_ids)
    record: dict[str, Any] = {
        "schema": "1.1",
        "material": {
            "id": str(uuid.UUID(bytes=digest[:16], version=4)),
            "name": f"fabric of {takes}",
            "description": " ".join(
                ["Measured from motion.", *caution_lines(result, fabric), "SI quantities are under custom.hangtime."]
            ),
            "created": result.created, "modified": result.created,
            "front": None, "back": None, "side": None,
            "physics": {
                "thickness": None, "weight": 1e3 * fabric["areal_density"].value, "devices": {"fab": "null"},
                "composition": None, "material_type": None, "construction": None,
            },
            "metadata": None,
        },
        "custom": {
            "hangtime": {
                "provenance": provenance(result),
                "fabric": {q.name: quantity_record(q) for q in fabric.quantities},
            }
        },
    }  # fmt: skip
    return json.dumps(record, indent=2).encode() + b"\n"
