"""One drive: rigid, or series elastic (SEA), with its losses and limits."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from pkmsea.files import Record

Positive = Annotated[float, Field(gt=0)]
NotNegative = Annotated[float, Field(ge=0)]


class Bounds(Record):
    """Range in which a stiffness is optimised [N m/rad, N/m]."""

    bounds: tuple[Positive, Positive]

    @model_validator(mode="after")
    def _ordered(self) -> Bounds:
        if self.bounds[0] >= self.bounds[1]:
            raise ValueError("the lower bound of the stiffness is not below the upper one")
        return self


class Drive(Record):
    """A drive between motor and joint; all values are seen at the output side of the gear.

    rigid:          tau = M_M dv_A/dt + d_v v_A + u             power  tau v_A  + kappa tau^2
    series elastic: tau = M_M dv_M/dt + d_v v_M + u,
                      u = c (q_M - q_A)                         power  tau v_M  + kappa tau^2
    """

    kind: Literal["rigid", "sea"]
    inertia: NotNegative = Field(description="rotor inertia M_M [kg m^2, kg]")
    friction: NotNegative = Field(0.0, description="viscous friction d_v [N m s/rad, N s/m]")
    copper_loss: Positive = Field(description="kappa = R / k_m^2 [W/(N m)^2, W/N^2]")
    stiffness: Positive | Bounds | None = Field(None, description="fixed, or {bounds: [low, high]} to optimise it")
    torque: Positive | None = Field(None, description="largest motor torque [N m, N]")
    speed: Positive | None = Field(None, description="largest motor speed [rad/s, m/s]")

    @model_validator(mode="after")
    def _stiffness_fits_kind(self) -> Drive:
        if self.kind == "sea" and self.stiffness is None:
            raise ValueError("a series elastic drive needs a stiffness: a number, or {bounds: [low, high]}")
        if self.kind == "rigid" and self.stiffness is not None:
            raise ValueError("a rigid drive has no stiffness; remove it or set kind: sea")
        return self

    @property
    def elastic(self) -> bool:
        return self.kind == "sea"

    @property
    def stiffness_range(self) -> tuple[float, float]:
        """Lower and upper bound of c; equal where the stiffness is fixed."""
        if isinstance(self.stiffness, Bounds):
            return self.stiffness.bounds
        if self.stiffness is None:
            raise ValueError("a rigid drive has no stiffness")
        return self.stiffness, self.stiffness
