"""Groups of people, and the fields with which robots watch for them."""

from dataclasses import dataclass

from mrp_sumo.core.options import Options, option


@dataclass(frozen=True, kw_only=True)
class Group(Options):
    """People who walk alike: their speeds are normally distributed, cut off two standard deviations from the mean."""

    name: str = option("", "For people who read the file.")
    share: float = option(1.0, "Share of all people, relative to other groups.", gt=0, le=1e6)
    speed_mps: float = option(1.34, "Mean preferred speed.", gt=0, le=5)
    spread_mps: float = option(0.26, "Standard deviation; cut off at two of them.", ge=0, le=2)
    headway_s: float = option(0.75, "Time by which they keep more than `spacing_m` behind others.", gt=0, le=5)
    spacing_m: float = option(0.45, "Distance of centres at which they stand behind others.", ge=0.2, le=2)


@dataclass(frozen=True, kw_only=True)
class ProtectiveFields(Options):
    """The warning and protective fields of robots.

    At speed v the protective field reaches S_L = S_A + TZ + Z_R + Z_F + Z_B with S_A = v^2 / (2 d) + v (t_control + t_scanner), where d is
    the deceleration of the robot's type.
    """

    active: bool = option(True, "Whether robots have them; else they take no notice of people.")
    scanner_s: float = option(0.1, "Response time of the scanner.", ge=0, le=5)
    control_s: float = option(0.1, "Response time of control and brakes.", ge=0, le=5)
    tolerance_m: float = option(0.1, "TZ, tolerance of the scanner's distances.", ge=0, le=5)
    reflection_m: float = option(0.2, "Z_R, for reflectors nearby.", ge=0, le=5)
    ground_m: float = option(0.05, "Z_F, for want of ground clearance.", ge=0, le=5)
    braking_m: float = option(0.1, "Z_B, for brakes that have worn.", ge=0, le=5)
    side_m: float = option(0.1, "Width of the field beside the footprint, and around a robot that turns.", ge=0, le=5)
    slowest_mps: float = option(0.1, "Speed to which somebody in the warning field slows a robot.", gt=0, le=5)
    restart_s: float = option(2.0, "Time that the protective field has to be free before the robot goes on.", ge=0, le=60)

    @property
    def extra_m(self) -> float:
        """TZ + Z_R + Z_F + Z_B."""
        return self.tolerance_m + self.reflection_m + self.ground_m + self.braking_m


EVERYBODY = (Group(),)
USUAL_FIELDS = ProtectiveFields()
