"""OpenTelemetry traces: a span for every request, those of parsing and folding below it, sent where the settings say."""

from collections.abc import MutableMapping
from typing import TYPE_CHECKING, Any

from fastapi.telemetry import TelemetryConfig
from opentelemetry import trace

from service import __version__
from service.settings import Settings

if TYPE_CHECKING:
    from opentelemetry.sdk.trace import TracerProvider

_UNTOLD = frozenset({"/healthz", "/readyz", "/metrics", "/sign-in", "/sign-in/oidc/callback"})
"""Probes are noise; what a provider sends a browser back with is a secret for a moment."""


def telemetry(settings: Settings) -> tuple[TelemetryConfig, "TracerProvider | None"]:
    """How the application tells of its requests, and what has to be shut down with it.

    Raises
    ------
    RuntimeError
        when traces are asked for and cannot be sent: the words name what to install.
    """
    untold: TelemetryConfig = {"tracing": False, "metrics": False, "logs": False, "auto_configure": False}
    if settings.traces == "off":
        return untold, None
    provider = _provider(settings)
    # spans of libraries and of other rooms hang below the request's by the same provider
    trace.set_tracer_provider(provider)
    told: TelemetryConfig = {
        "tracer_provider": provider,
        "metrics": False,
        "logs": False,
        "operation_spans": False,
        "auto_configure": False,
        "exclude": _is_untold,
    }
    return told, provider


def tell_of(request_id: str, principal: str | None, operator: str | None) -> None:
    """Add to the request's span what the log says of it."""
    span = trace.get_current_span()
    if span.is_recording():
        said = {"casedrain.request_id": request_id, "enduser.id": principal, "casedrain.operator": operator}
        span.set_attributes({name: value for name, value in said.items() if value is not None})


def _is_untold(scope: MutableMapping[str, Any]) -> bool:
    return scope.get("path") in _UNTOLD


def _provider(settings: Settings) -> "TracerProvider":
    try:
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter  # noqa: PLC0415 - an extra
        from opentelemetry.sdk.resources import Resource  # noqa: PLC0415
        from opentelemetry.sdk.trace import TracerProvider  # noqa: PLC0415
        from opentelemetry.sdk.trace.export import BatchSpanProcessor  # noqa: PLC0415
    except ImportError:
        raise RuntimeError("CASEDRAIN_TRACES=otlp needs the extra: pip install 'casedrain[traces]'") from None
    named = {"service.name": "casedrain", "service.version": __version__, "service.instance.id": settings.worker_name}
    provider = TracerProvider(resource=Resource.create(named))
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    return provider
