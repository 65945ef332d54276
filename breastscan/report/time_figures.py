"""Where the wall time of a scan went."""

from matplotlib.figure import Figure

from breastscan.report import theme
from breastscan.report.catalogue import number

BAR_HEIGHT_IN = 0.3


def wall_time(seconds: dict[str, float]) -> Figure:
    """One bar for each stage, in the order in which they ran [s]."""
    figure, ((axis,),) = theme.panels(1, 1, height_in=0.8 + BAR_HEIGHT_IN * len(seconds))
    bars = axis.barh(list(seconds), list(seconds.values()), color=theme.MEASURED, height=0.6)
    labels = axis.bar_label(
        bars, [f"{number(value)} s" for value in seconds.values()], padding=4, color=theme.INK
    )
    for label in labels:
        label.set_fontsize(8.5)
    axis.set_xlabel("wall time [s]")
    axis.margins(x=0.1)
    axis.grid(visible=False, axis="y")
    axis.invert_yaxis()
    return figure
