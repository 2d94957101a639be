"""A short run of the state machine over the real application; `python -m tests.session_machine` runs long."""

from tests.session_machine import run_machine


def test_the_session_is_what_a_simple_model_says() -> None:
    run_machine(25, 7, 4)
