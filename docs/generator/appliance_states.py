"""Draw the appliance's states and what leads from one to another, from the table that the daemon follows."""

from __future__ import annotations

from xml.etree.ElementTree import Element, SubElement, indent, tostring

from capture.appliance.states import TRANSITIONS, Event, State

WIDTH, HEIGHT = 860, 450
BOX = 110, 36  # px
PLACES = {
    State.STARTING: (90, 60), State.READY: (430, 60), State.ARMED: (770, 60),
    State.FAULT: (90, 250), State.SYNCING: (430, 250), State.RECORDING: (770, 250), State.SAVING: (600, 400),
}  # fmt: skip
SHORT = {
    Event.SOUND: "sound", Event.FAULTY: "faulty", Event.HANGER_SEEN: "hanger seen", Event.HANGER_GONE: "hanger gone",
    Event.START: "start", Event.STOP: "stop", Event.SAVED: "saved", Event.SYNC_BEGAN: "sync began",
    Event.SYNC_ENDED: "sync ended",
}  # fmt: skip
ASIDE = 8  # px by which an arrow runs on the right of the straight way, so that there and back are two
LABEL_AT = 0.4  # of the way


def appliance_states_page() -> str:
    """Return the drawing as a piece of a page."""
    return f"```{{raw}} html\n{picture()}\n```\n"


def picture() -> str:
    """Return the drawing as SVG."""
    ways: dict[tuple[State, State], list[str]] = {}
    for (before, event), after in TRANSITIONS.items():
        ways.setdefault((before, after), []).append(SHORT[event])
    drawing = Element("svg", {
        "viewBox": f"0 0 {WIDTH} {HEIGHT}", "xmlns": "http://www.w3.org/2000/svg", "role": "img",
        "aria-label": "states of the appliance", "font-family": "sans-serif", "font-size": "13",
        "fill": "currentColor",
    })  # fmt: skip
    tip = SubElement(SubElement(drawing, "defs"), "marker", {
        "id": "tip", "viewBox": "0 0 8 8", "refX": "7", "refY": "4", "markerWidth": "7", "markerHeight": "7",
        "orient": "auto",
    })  # fmt: skip
    SubElement(tip, "path", {"d": "M0 0L8 4L0 8z"})
    for (before, after), events in ways.items():
        _add_arrow(drawing, PLACES[before], PLACES[after], ", ".join(events))
    for state in State:
        _add_box(drawing, state)
    indent(drawing, "")
    return tostring(drawing, encoding="unicode")


def _add_box(drawing: Element, state: State) -> None:
    (x, y), (width, height) = PLACES[state], BOX
    SubElement(drawing, "rect", {
        "x": f"{x - width // 2}", "y": f"{y - height // 2}", "width": f"{width}", "height": f"{height}", "rx": "8",
        "fill": "none", "stroke": "currentColor",
    })  # fmt: skip
    name = {"x": f"{x}", "y": f"{y + 5}", "text-anchor": "middle", "font-weight": "bold"}
    SubElement(drawing, "text", name).text = state.name.lower()


def _add_arrow(drawing: Element, begin: tuple[int, int], end: tuple[int, int], label: str) -> None:
    dx, dy = end[0] - begin[0], end[1] - begin[1]
    length = (dx * dx + dy * dy) ** 0.5
    ux, uy = dx / length, dy / length
    inside = min(BOX[0] / 2 / max(abs(ux), 1e-9), BOX[1] / 2 / max(abs(uy), 1e-9))
    side = -uy * ASIDE, ux * ASIDE
    x0, y0 = begin[0] + ux * (inside + 3) + side[0], begin[1] + uy * (inside + 3) + side[1]
    x1, y1 = end[0] - ux * (inside + 5) + side[0], end[1] - uy * (inside + 5) + side[1]
    x, y = x0 + LABEL_AT * (x1 - x0), y0 + LABEL_AT * (y1 - y0)
    SubElement(drawing, "line", {
        "x1": f"{x0:.0f}", "y1": f"{y0:.0f}", "x2": f"{x1:.0f}", "y2": f"{y1:.0f}", "stroke": "currentColor",
        "opacity": "0.6", "marker-end": "url(#tip)",
    })  # fmt: skip
    SubElement(drawing, "text", {
        "x": f"{x + 0.9 * side[0]:.0f}", "y": f"{y + 1.4 * side[1] + 4:.0f}",
        "text-anchor": "middle" if abs(side[0]) < 5 else "start" if side[0] > 0 else "end",
    }).text = label  # fmt: skip
