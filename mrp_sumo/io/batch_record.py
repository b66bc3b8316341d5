"""Checks of the record of a batch's run, so that everything that reads records can rely on it.

A checksum says that a file is what was written, not that a batch wrote it. Keys that are not named here may hold anything.
"""

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator

from mrp_sumo.io.documents import in_words


class _Strict(BaseModel):
    model_config = ConfigDict(strict=True)


class _Group(_Strict):
    count: int | None = None
    starts: list[str] | None = None
    goals: list[str] | None = None


class _Robots(_Group):
    fleet: list[_Group] | None = None

    @model_validator(mode="after")
    def _counted(self) -> "_Robots":
        if any(group.count is None and group.starts is None and group.goals is None for group in self.fleet or [self]):
            raise ValueError("neither count nor starts")
        return self


class _Scenario(_Strict):
    robots: _Robots


class _Record(_Strict):
    key: str
    scenario_key: str
    status: str
    attempts: int
    success: bool
    reason: str
    scenario: _Scenario
    repeat: int
    until: str
    metrics: dict[str, Any]
    code: str
    libsumo: str
    ortools: str
    machine: str
    python: str
    run_wall_s: float | None
    run_cpu_s: float | None
    peak_memory_mb: float | None
    ended_at: str


def fault_of_record(body: bytes) -> str:
    """Fault in the content of a record, given as JSON; '' if there is none."""
    try:
        _Record.__pydantic_validator__.validate_json(body)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        return f"{'.'.join(map(str, first['loc'])) or 'it'}: {in_words(first['msg'])}"
    return ""
