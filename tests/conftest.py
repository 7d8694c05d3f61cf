"""No test fails because the machine is slow."""

from hypothesis import HealthCheck, settings

settings.register_profile("pfviz", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("pfviz")
