"""Errors that a user can act on: what was expected, what came, what to do."""


class BreastScanError(Exception):
    """Base of every error this package raises on purpose.

    Args:
        message: What was expected, what came, and what to do about it.
        value: The offending value, kept for programs that want to look at it.
    """

    def __init__(self, message: str, value: object = None) -> None:
        super().__init__(message)
        self.value = value


def notes_of(error: BaseException) -> list[str]:
    """What was noted on an error on its way, a sentence each."""
    return list(getattr(error, "__notes__", []))


class ConfigError(BreastScanError):
    """A setting, an argument or a file system path that cannot be used."""


class CalibrationError(BreastScanError):
    """A rig or hand-eye calibration that is missing, damaged or too poor to use."""


class PerceptionError(BreastScanError):
    """Images or points in which the breast cannot be measured."""


class NoBreastError(PerceptionError):
    """A view of something else: no breast stands on a plate in it."""


class PlanningError(BreastScanError):
    """A path that the curve, the feedrate or the arm cannot follow."""


class SafetyError(BreastScanError):
    """A limit that protects the patient or the robot was about to be passed."""


class RobotError(BreastScanError):
    """The robot, or its twin, refused or lost a command."""
