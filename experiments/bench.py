"""The benchmark table: how do speed and accuracy compare with named peers, measured interleaved
in one run?
"""

from rich.console import Console
from rich.table import Table
from rich.text import Text

from experiments import (
    bench_camera,
    bench_cloud,
    bench_control,
    bench_motion,
    bench_stereo,
    bench_twin,
)

SECTIONS = {
    "Stereo": bench_stereo.rows,
    "Clouds": bench_cloud.rows,
    "Motion": bench_motion.rows,
    "Twin": bench_twin.rows,
    "Control": bench_control.rows,
    "Cameras": bench_camera.rows,
}


def main() -> None:
    """Print the table; every section measures when its turn comes."""
    console = Console()
    for title, rows in SECTIONS.items():
        table = Table(title=title, title_justify="left")
        for heading in ("what", "own", "peer or budget", "peer / own"):
            table.add_column(heading, justify="left" if heading == "what" else "right")
        for what, own, peer, ratio in rows():
            table.add_row(Text(what), f"{own:.3g}", f"{peer:.3g}", f"{ratio:.2f}")
        console.print(table)


if __name__ == "__main__":
    main()
