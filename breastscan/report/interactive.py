"""Views that a page draws when it is opened, to turn, zoom or filter with the mouse."""

import plotly.graph_objects as go
from plotly.offline import get_plotlyjs

from breastscan.report import theme

LAYOUT = {
    "template": "none",
    "paper_bgcolor": "rgba(0,0,0,0)",
    "font": {"color": theme.READABLE_ON_BOTH, "family": "system-ui, sans-serif"},
    "modebar": {
        "bgcolor": "rgba(0,0,0,0)",
        "color": theme.READABLE_ON_BOTH,
        "activecolor": theme.MEASURED_ON_BOTH,
    },
}
"""How every view looks on the light and on the dark page."""

OPTIONS = '{responsive: true, displaylogo: false, showSendToCloud: false, plotlyServerURL: ""}'
"""Without the button that uploads a chart to plotly's server, which is there by default: a scan
stays where it is."""


def script(view: go.Figure, element: str, prepare: str = "") -> str:
    """The scripts that draw `view`: plotly.js itself, so that the page needs no network.

    Args:
        view: What is drawn.
        element: Where on the page.
        prepare: Statements that run before, which may change `view`.
    """
    content = str(view.to_json()).replace("<", "\\u003c")
    call = (
        f"const view = {content}; {prepare} "
        f'Plotly.newPlot("{element}", view.data, view.layout, {OPTIONS});'
    )
    return f"<script>{get_plotlyjs()}</script>\n<script>{call}</script>"
