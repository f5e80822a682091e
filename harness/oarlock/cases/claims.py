"""What a paper says of a mechanism and what is so: a JSON file beside the case, which a script of its own makes."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from oarlock.base.errors import InputError, one_line
from oarlock.base.files import reading
from oarlock.cases.case import Case


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)


class Measured(_Strict):
    """A figure: what it is, with its unit, and its value."""

    what: str
    value: int | Annotated[float, Field(allow_inf_nan=False)]


class Claim(_Strict):
    """A claim and what was found.

    Attributes:
        claim: what is said.
        holds: whether it is so.
        instead: what is so, if it is not; or empty.
        figures: what says so.
    """

    claim: str
    holds: bool
    instead: str
    figures: Annotated[list[Measured], Field(min_length=1)]


def load_claims(case: Case) -> list[Claim]:
    """Loads the claims of the paper of a case; empty if it names none.

    Raises:
        InputError: the file is missing or malformed.
    """
    if case.file.paper is None or case.file.paper.claims is None:
        return []
    with reading(case.folder / case.file.paper.claims) as path:
        text = path.read_bytes()
    try:
        return TypeAdapter(list[Claim]).validate_json(text)
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {place or 'the file'}: {one_line(first['msg'])}") from None
