"""What others say of a mechanism: a trajectory, values at one time, a paper."""

from typing import Annotated

from pydantic import BaseModel, Field, model_validator

from oarlock.cases.table import STRICT, Finite, NonNegative, Positive


class _Table(BaseModel):
    model_config = STRICT


class _Observed(_Table):
    """Base of tables that are about the coordinate of one joint or the place of one site."""

    joint: str | None = None
    site: str | None = None

    @model_validator(mode="after")
    def _one(self) -> "_Observed":
        named = [kind for kind, name in self if kind in ("joint", "site", "equality") and name is not None]
        if len(named) != 1:
            choice = "joint, site or equality" if hasattr(self, "equality") else "joint or site"
            raise ValueError(f"names {' and '.join(named) or 'nothing'}, expected exactly one of {choice}")
        return self


class Truth(_Observed):
    """Outside truth: a trajectory in a CSV file.

    The columns are time, position, velocity and acceleration of a joint (rad or m), or time, x, y, z, vx, vy, vz, ax,
    ay, az of a site (m, world frame).

    Attributes:
        joint: name of the joint that it is of.
        site: name of the site that it is of, in place of a joint.
        file: name of the file. ``{N}`` in it stands for the value of the parameter N; without it, it holds for all.
        source: where the trajectory comes from.
    """

    file: str
    source: str


class Published(_Observed):
    """A value that others published, of a joint, a site or an equality at one time.

    Attributes:
        joint: name of the joint that the value is of.
        site: name of the site that it is of, in place of a joint.
        time_s: time, s.
        equality: name of the equality, if the value is its multipliers.
        position: coordinate of a joint (rad or m), or place of a site (m, world frame).
        velocity: velocity of a joint, rad/s or m/s.
        multipliers: multipliers of an equality, one per row, in MuJoCo's sign.
        source: where the value was published.
    """

    time_s: NonNegative
    equality: str | None = None
    position: Finite | list[Finite] | None = None
    velocity: Finite | None = None
    multipliers: Annotated[list[Finite], Field(min_length=1)] | None = None
    source: str

    @model_validator(mode="after")
    def _fitting(self) -> "Published":
        given = {name for name in ("position", "velocity", "multipliers") if getattr(self, name) is not None}
        if self.joint is not None:
            what, fits = "position and/or velocity, a number each", not isinstance(self.position, list)
            fits = fits and bool(given) and given <= {"position", "velocity"}
        elif self.site is not None:
            what, fits = "position = [x, y, z] and nothing else", given == {"position"}
            fits = fits and isinstance(self.position, list) and len(self.position) == 3
        else:
            what, fits = "multipliers = [a number a row] and nothing else", given == {"multipliers"}
        if not fits:
            kind = "joint" if self.joint is not None else "site" if self.site is not None else "equality"
            raise ValueError(f"gives {', '.join(sorted(given)) or 'nothing'}, expected of a {kind} {what}")
        return self


class Paper(_Table):
    """What others published of the same mechanism, shown in the report.

    Attributes:
        source: who published it.
        iterations_mean: iterations a solve.
        claims: file of what they say of it, and of what came out; see ``oarlock.cases.claims``.
    """

    source: str
    iterations_mean: Positive | None = None
    claims: str | None = None
