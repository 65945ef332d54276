"""README's table of results states the bars that every scan is shown beside, and no others."""

import re
from pathlib import Path

from breastscan.report import catalogue
from breastscan.run.bars import BARS

README = Path(__file__).parents[2] / "README.md"
ROW = re.compile(
    r"\| (?P<label>[^|]+): `(?P<key>\w+)` \| (?P<bar>[≤≥][^|]+) \| .+ \| `(?P<command>.+)` \|"
)


def test_readmes_rows_are_the_bars():
    lines = README.read_text(encoding="utf-8").splitlines()
    rows = [found.groupdict() for line in lines if (found := ROW.fullmatch(line))]
    metrics = [catalogue.metric_of(bar.key) for bar in BARS]
    assert rows == [
        {
            "label": metric.label,
            "key": bar.key,
            "bar": metric.bar_text(bar),
            "command": bar.command,
        }
        for bar, metric in zip(BARS, metrics, strict=True)
    ]
