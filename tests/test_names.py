"""The field's words: no name that a reader of robotics and stereo would have to learn anew."""

import re
import tokenize
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
INSTEAD = {
    "surprise": "innovation",
    "unrest": "process noise",
    "believed": "estimated, inlier",
    "doubtful": "scale of the robust loss",
    "demand": "phase command",
    "let_through": "limit_command",
    "hurry": "overspeed time",
    "haste": "pressing-speed ratio",
    "judge_skin": "check_skin",
    "look_anew": "resync",
    "spin": "roll",
    "spins": "rolls",
    "spun": "rolled",
    "dilation": "time scaling",
    "passing": "transient",
    "kick": "feed the watchdog",
    "told_lag": "reported lag",
    "onlooker": "observer",
    "wishes": "viewer commands",
    "eyes": "open_camera",
    "greet": "on_connect",
    "splat": "broadcast",
    "unembed": "inverse map",
}
"""Each word that no identifier contains, and the field's."""
WORD = re.compile(rf"(?:^|_)({'|'.join(INSTEAD)})(?=_|$)")


def identifiers(path: Path) -> set[str]:
    with path.open("rb") as file:
        tokens = tokenize.tokenize(file.readline)
        return {token.string for token in tokens if token.type == tokenize.NAME}


@pytest.mark.parametrize("folder", ["breastscan", "sim", "experiments"])
def test_identifiers_are_the_fields_words(folder):
    found = [
        f"{path.relative_to(ROOT)}: {name}, say {INSTEAD[word[1]]}"
        for path in sorted((ROOT / folder).rglob("*.py"))
        for name in sorted(identifiers(path))
        if (word := WORD.search(name.lower()))
    ]
    assert not found, "\n".join(found)
