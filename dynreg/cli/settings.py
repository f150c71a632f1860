"""Settings: a TOML file, then DYNREG_* variables, then flags; the later ones win."""

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model

from dynreg.errors import UsageError
from dynreg.session import rows
from dynreg.tomlfile import read_toml
from dynreg.verbs.settings import options

FILE = Path("dynreg.toml")
PREFIX = "DYNREG_"


class _Global(BaseModel):
    """What a settings file may hold: this, and what the verbs share; None leaves the choice to the command."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    registry: Path | None = None
    quiet: bool = False


Settings = create_model(
    "Settings",
    __base__=_Global,
    **{
        one.name: (Annotated[one.type | None, Field(ge=how.least)], None)
        for row in rows().values()
        for one, how in options(row.settings)
        if how.shared
    },
)


def read_settings(file: Path | None, environment: Mapping[str, str] = os.environ) -> Settings:
    """The settings of `file` (else of ./dynreg.toml where there is one), overridden by the environment.

    Raises UsageError that names the file and its line, or the variable.
    """
    if file is None and not FILE.is_file():
        base = Settings()
    else:
        base = read_toml(file or FILE, Settings, UsageError)
    given = {
        key: environment[PREFIX + key.upper()]
        for key in Settings.model_fields
        if environment.get(PREFIX + key.upper())
    }
    try:
        return Settings.model_validate({**base.model_dump(), **given})
    except ValidationError as error:
        raise _variable_error(error.errors()[0]) from None


def _variable_error(found: Mapping[str, Any]) -> UsageError:
    name = PREFIX + str(found["loc"][0]).upper()
    return UsageError(
        f"{name}={found['input']!r}: {found['msg']}",
        expected=f"a value that fits `{found['loc'][0]}`",
        do=f"correct or unset {name}",
    )
