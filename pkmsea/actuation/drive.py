"""One drive: rigid, or series elastic (SEA), with its losses and limits."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from pkmsea.files import Record

LARGEST = 1e30  # of any number of a task, in SI units: far beyond sense, and its powers are still numbers
SMALLEST = 1e-30  # likewise


def _not_tiny(number: float) -> float:
    if number < SMALLEST:
        raise ValueError(f"no quantity is smaller than {SMALLEST:g}")
    return number


Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, Field(gt=0, le=LARGEST), AfterValidator(_not_tiny)]
NotNegative = Annotated[float, Field(ge=0, le=LARGEST)]
ParameterKind = Literal["c", "k", "rest"]  # stiffness in series; stiffness and rest position in parallel


class Range(Record):
    """Range in which a number of a drive is optimised."""

    bounds: tuple[Number, Number]

    @model_validator(mode="after")
    def _ordered(self) -> Range:
        if self.bounds[0] >= self.bounds[1]:
            raise ValueError("the lower bound is not below the upper one")
        return self


class Bounds(Range):
    """Range in which a stiffness is optimised [N m/rad, N/m]."""

    bounds: tuple[Positive, Positive]


class ParallelSpring(Record):
    """A spring between a joint and the link before it: u_P = k (rest - q_A)."""

    stiffness: Positive | Bounds = Field(description="k, fixed or {bounds: [low, high]} to optimise it [N m/rad, N/m]")
    rest: Number | Range = Field(description="position without force, fixed or {bounds: [low, high]} [rad, m]")


class Drive(Record):
    """A drive between motor and joint; all values are seen at the output side of the gear, unless `gear_ratio` is set.

    rigid:          tau = M_M dv_A/dt + d_v v_A + F(v_A) + u             power  tau v_A  + kappa tau^2
    series elastic: tau = M_M dv_M/dt + d_v v_M + F(v_M) + u,
                      u = c e + c_3 e^3 + d_s de/dt, e = q_M - q_A       power  tau v_M  + kappa tau^2

    F(v) = F_C tanh(v / w) is Coulomb friction, smoothed over the speed w. A spring in parallel adds to u at the joint.
    """

    kind: Literal["rigid", "sea"]
    inertia: NotNegative = Field(description="rotor inertia M_M [kg m^2, kg]")
    friction: NotNegative = Field(0.0, description="viscous friction d_v [N m s/rad, N s/m]")
    coulomb: NotNegative = Field(0.0, description="Coulomb friction F_C [N m, N]")
    coulomb_width: Positive = Field(0.1, description="speed w at which 76 % of it acts [rad/s, m/s]")
    copper_loss: Positive = Field(description="kappa = R / k_m^2 [W/(N m)^2, W/N^2]")
    stiffness: Positive | Bounds | None = Field(None, description="fixed, or {bounds: [low, high]} to optimise it")
    cubic: NotNegative = Field(0.0, description="cubic stiffness c_3 of a hardening spring [N m/rad^3, N/m^3]")
    damping: NotNegative = Field(0.0, description="damping d_s of the spring [N m s/rad, N s/m]")
    parallel: ParallelSpring | None = Field(None, description="a spring in parallel to the drive (PEA)")
    torque: Positive | None = Field(None, description="largest motor torque [N m, N]")
    speed: Positive | None = Field(None, description="largest motor speed [rad/s, m/s]")
    gear_ratio: Positive | None = Field(
        None, description="motor turns per output turn; inertia, friction, coulomb, coulomb_width, copper_loss, torque "
        "and speed are then the motor's own"
    )  # fmt: skip

    @model_validator(mode="after")
    def _stiffness_fits_kind(self) -> Drive:
        if self.kind == "sea" and self.stiffness is None:
            raise ValueError("a series elastic drive needs a stiffness: a number, or {bounds: [low, high]}")
        if self.kind == "rigid" and (self.stiffness is not None or self.cubic or self.damping):
            raise ValueError("a rigid drive has no spring; remove stiffness, cubic and damping, or set kind: sea")
        if self.cubic and self.damping:
            raise ValueError("a spring with both cubic and damping is not modelled; remove one of them")
        return self

    @property
    def elastic(self) -> bool:
        return self.kind == "sea"

    @property
    def law(self) -> str:
        """Its name in `pkmsea.actuation.kinds.KINDS`."""
        return "rigid" if not self.elastic else "damped" if self.damping else "cubic" if self.cubic else "linear"

    @property
    def stiffness_range(self) -> tuple[float, float]:
        """Lower and upper bound of c; equal where the stiffness is fixed."""
        return self.range_of("c")

    def range_of(self, parameter: ParameterKind) -> tuple[float, float]:
        """Lower and upper bound of a number that can be optimised; equal where it is fixed."""
        values: dict[str, float | Range | None] = {"c": self.stiffness}
        if self.parallel is not None:
            values |= {"k": self.parallel.stiffness, "rest": self.parallel.rest}
        value = values.get(parameter)
        if value is None:
            raise ValueError(f"this drive has no {parameter}")
        return value.bounds if isinstance(value, Range) else (value, value)

    def at_output(self) -> Drive:
        """The same drive with all values seen at the output side of its gear: inertia i^2 J, torque i tau and so on."""
        i = self.gear_ratio
        if i is None:
            return self
        factors = {
            "inertia": i**2, "friction": i**2, "coulomb": i, "coulomb_width": 1 / i, "copper_loss": 1 / i**2,
            "torque": i, "speed": 1 / i,
        }  # fmt: skip
        values = {key: getattr(self, key) for key in factors}
        seen = {key: None if value is None else value * factors[key] for key, value in values.items()}
        return self.model_copy(update={**seen, "gear_ratio": None})
