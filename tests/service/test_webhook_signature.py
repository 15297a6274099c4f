"""Signatures of webhooks against the standard's own example, and the hosts that settings allow."""

from service.notifications.signature import signed_headers
from service.settings import Settings


def test_the_example_of_the_standard() -> None:
    # Standard Webhooks, reference library's test vector: secret, id, timestamp, payload and signature
    headers = signed_headers(
        "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw",
        "msg_p5jXN8AQM9LWM0D4loKWxJek",
        1614265330,
        b'{"test": 2432232314}',
    )
    assert headers["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="


def test_hosts_of_the_premises_come_from_the_settings() -> None:
    assert Settings(webhook_allowed_hosts=" Hook.local, 10.0.0.5,").webhook_hosts == {"hook.local", "10.0.0.5"}
