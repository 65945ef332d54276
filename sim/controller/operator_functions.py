"""The functions that tell the operator something."""

from collections.abc import Generator, Iterable

from sim.controller.controller import Controller
from sim.controller.messages import Popup, Text
from sim.controller.states import RobotMode
from sim.controller.urscript.signature import ANYTHING, CONDITION, Function, Parameter, row
from sim.controller.urscript.values import Value, make_string


def operator_functions(controller: Controller) -> Iterable[Function]:
    """Their rows."""

    def tell(first: Value, second: Value) -> None:
        controller.messages.append(Text(make_string([first, second])))

    def popup(
        s: Value, title: Value, warning: bool, error: bool, blocking: bool
    ) -> Generator[None, None, None]:
        shown = Popup(make_string([s]), make_string([title]), warning, error, blocking)
        controller.popup = shown
        controller.messages.append(shown)
        while blocking and controller.popup is shown:
            yield

    title = Parameter("title", ANYTHING, "Popup")
    flags = (Parameter(name, CONDITION, False) for name in ("warning", "error", "blocking"))
    message = Parameter("s1", ANYTHING), Parameter("s2", ANYTHING, "")
    yield row("textmsg", tell, *message, costly=True)
    yield row("popup", popup, Parameter("s", ANYTHING), title, *flags, waits=True)
    yield row("powerdown", lambda: controller.power(RobotMode.POWER_OFF), costly=True)
