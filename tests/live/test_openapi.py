"""The description of the service is held against the service by schemathesis."""

import pytest

from tests.live.in_thread import serving


@pytest.mark.slow
@pytest.mark.filterwarnings("default")
def test_schemathesis_finds_nothing():
    schemathesis = pytest.importorskip("schemathesis")
    with serving() as inside:
        inside.service.supervisor.is_ready = True  # else /readyz answers 503, as it should
        schema = schemathesis.openapi.from_url(f"{inside.address}/openapi.json")
        problems = []
        for result in schema.get_all_operations():
            problems += _problems(result.ok())
        assert not problems


def _problems(operation) -> list[str]:
    """Returns what schemathesis finds wrong with the answers to some questions that it draws."""
    from hypothesis import HealthCheck, Phase, given, settings

    found: list[str] = []

    @given(case=operation.as_strategy())
    @settings(
        max_examples=15,
        deadline=None,
        database=None,
        derandomize=True,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    def check(case) -> None:
        try:
            case.call_and_validate()
        except BaseExceptionGroup as error:
            found.append(f"{operation.label}: {error}")

    check()
    return found[:3]
