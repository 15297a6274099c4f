"""Signatures of webhooks, against the standard's own words."""

import base64
import hashlib
import hmac
import json

from service.notifications.signature import signed_headers


class TestSignature:
    def test_the_example_of_the_standard(self) -> None:
        # Standard Webhooks, reference library's test vector: secret, id, timestamp, payload and signature
        headers = signed_headers(
            "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw",
            "msg_p5jXN8AQM9LWM0D4loKWxJek",
            1614265330,
            b'{"test": 2432232314}',
        )
        assert headers["webhook-signature"] == "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE="

    def test_a_receiver_can_verify_what_arrives(self, guarded: TestClient, admin: dict[str, str], inbox: Inbox) -> None:
        secret = hook(guarded, admin, inbox.url)["secret"]
        write(guarded, "hi")
        assert postman(guarded).turn() == 1
        path, headers, body = inbox.requests[0]
        assert path == "/hook?from=casedrain"
        signed = f"{headers['webhook-id']}.{headers['webhook-timestamp']}.".encode() + body
        expected = hmac.new(base64.b64decode(secret.removeprefix("whsec_")), signed, hashlib.sha256).digest()
        assert headers["webhook-signature"] == "v1," + base64.b64encode(expected).decode()
        document = json.loads(body)
        assert document["type"] == "alarm.raised"
        assert document["timestamp"].endswith("Z")
        assert document["data"]["pump_serial"] == "P-1"
