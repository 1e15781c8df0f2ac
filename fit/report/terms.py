"""Section of the report that explains the terms on the page."""

from __future__ import annotations

from markupsafe import Markup

from fit.report.templating import piece
from formats.diagnosis_records import Diagnosis

OF_A_DIAGNOSIS = {
    "Gap": "The error of the simulation on motion that was not used to fit it, as far as it is larger than the "
    "sensor's noise. Below the noise floor nothing can be seen and nothing is claimed.",
    "Gap closed": "How much of the gap disappears once an effect is modelled and everything is fitted again, on motion "
    "not used to fit. The share is of squared errors, less the square of the noise. 100 % means down to the noise; "
    "more means that less is left than the noise was estimated to be. An effect that merely fits noise closes nothing.",
    "Probability": "How the library's effects rank as causes of this gap. It is no test, and considers no cause "
    "outside the library. Without a held-out take it does not allow for the choice among the effects, so it flatters.",
    "Size": "How strong the effect has to be, in its own unit. An interval that includes zero means: "
    "maybe not there. It reaches zero where the judged takes do not confirm that the effect lowers the error.",
    "p-value": "How often data without the effect would look this much like it, times the number of effects that were "
    "tried. These are the refitted ones, or without a held-out take all of them.",
    "Smallest that would show": "The smallest size that this recording could have revealed. An effect that was not "
    "found may still be there below this. Without a figure, the recording could not have shown the effect.",
}
# In place of those above, where evidence decided: no p-value is computed, and the judged takes change no interval.
BY_EVIDENCE = {
    "Probability": "The mass of the sets of effects that hold the effect, weighed on the takes fitted to. All sets "
    "and an unknown cause are 100 % together.",
    "Size": "How strong the effect has to be, in its own unit. An interval that includes zero means: maybe not there.",
}
NO_P_VALUE = "p-value"  # the term that `BY_EVIDENCE` leaves out
OF_PARAMETERS = {
    "90 % interval": "Of a fitted value, if the model is right. The interval covers the takes' noise and the local "
    "minima that the search found. The interval covers neither missing physics nor the mesh's error. The interval of "
    "an effect's size also covers mesh, solver and other laws of the effect.",
    "Held out": "Motion that no fit has seen. An error on motion used to fit flatters.",
    "Not identified": "This recording cannot tell the value, so the parameter has an interval and no value. Other "
    "parameters can make up for this one, or the range stopped it.",
    "At its bound": "The range stopped this parameter, so the interval reaches the end of the range.",
}


def reading(diagnosis: Diagnosis | None) -> Markup:
    """Return the section that explains the terms used on the page."""
    known = OF_A_DIAGNOSIS if diagnosis is not None else {}
    if diagnosis is not None and diagnosis.options.get("--by") == "evidence":
        known = {term: said for term, said in (OF_A_DIAGNOSIS | BY_EVIDENCE).items() if term != NO_P_VALUE}
    return piece("parts.html", "reading", known | OF_PARAMETERS)
