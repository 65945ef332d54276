"""What the simulated controller pretends to be."""

import ipaddress
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from breastscan.errors import ConfigError

Version = Literal["3.15", "5.11", "5.22", "5.25", "5.26", "10.11"]
"""Of the controller's software. 10 has no dashboard; 3.15 speaks the protocol and was never that of
a UR5e."""
Clock = Literal["real-time", "lockstep"]
"""What simulated time goes by: the wall clock, and in lockstep the client's answers as well."""


@dataclass(frozen=True, kw_only=True)
class ControllerConfig:
    """The controller on the network."""

    host: str = "127.0.0.1"
    """Address to listen at; the ports are those of a controller, so a second twin needs another one
    (127.0.0.2)."""
    expose: bool = False
    """Whether an address that others can reach is meant: there is no authentication, as on a
    robot."""
    version: Version = "5.22"
    """Of the software: what it tells, and which ports it serves."""
    model: str = "UR5"
    """What the dashboard names; a UR5e says UR5."""
    remote_control: bool = True
    """Whether the teach pendant has handed over."""
    programs: Path | None = None
    """Folder that the dashboard loads programs from: of a name.urp that PolyScope has saved, the
    name.script beside it is what runs. None has no programs."""
    clock: Annotated[Clock, tyro.conf.arg(prefix_name=False)] = "real-time"
    """lockstep: while a program streams targets, a period waits until their client has answered
    the last state, for 2 s at most, and noise, drift and breath count from the last tare: what
    follows a tare is then the same on a busy machine, and in every run."""
    real_time: bool = True
    """Whether to ask the system for real-time priority."""

    def __post_init__(self) -> None:
        try:
            address = ipaddress.ip_address(self.host)
        except ValueError as error:
            raise ConfigError(
                f"host must be an IP address, got {self.host!r}", self.host
            ) from error
        if not (address.is_loopback or self.expose):
            raise ConfigError(
                f"{self.host} can be reached by others, and whoever connects moves the arm: add "
                "--controller.expose if that is meant",
                self.host,
            )
        if self.programs is not None and not self.programs.is_dir():
            raise ConfigError(f"programs must be a folder, got {self.programs}", self.programs)

    @property
    def numbers(self) -> tuple[int, int, int, int]:
        """Version as major, minor, bug fix, build."""
        major, minor = self.version.split(".")
        return int(major), int(minor), 0, 0

    @property
    def e_series(self) -> bool:
        """Whether the software is the e-Series', or newer."""
        return self.numbers[0] >= 5
