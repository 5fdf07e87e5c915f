"""The same examples in every run, whatever the machine is busy with."""

from hypothesis import HealthCheck, settings

settings.register_profile(
    "isolux",
    derandomize=True,
    deadline=None,
    max_examples=100,
    suppress_health_check=[HealthCheck.too_slow],
)
settings.load_profile("isolux")
