"""Mails about alarms through the installation's own server; off where none is configured."""

import smtplib
import ssl
from collections.abc import Mapping
from email.message import EmailMessage
from email.utils import formatdate
from typing import Any

from service.notifications.webhook_call import Outcome
from service.settings import Settings

_TIMEOUT_S = 15.0


def send(settings: Settings, address: str, message_id: str, payload: Mapping[str, Any]) -> Outcome:
    """Send one message to one address; what goes wrong is said in the outcome and never raised."""
    if not settings.smtp_host:
        return Outcome(False, "not sent: no mail server is configured (CASEDRAIN_SMTP_HOST)")
    try:
        with smtplib.SMTP(settings.smtp_host, settings.smtp_port, timeout=_TIMEOUT_S) as server:
            if settings.smtp_security == "starttls":
                server.starttls(context=ssl.create_default_context())
            if settings.smtp_user:
                server.login(settings.smtp_user, settings.smtp_password.get_secret_value())
            server.send_message(_mail(settings, address, message_id, payload))
    except (OSError, smtplib.SMTPException) as error:
        return Outcome(False, f"no delivery: {type(error).__name__}")
    return Outcome(True, "taken by the mail server")


def _mail(settings: Settings, address: str, message_id: str, payload: Mapping[str, Any]) -> EmailMessage:
    alarm = payload["data"]
    words = str(payload["type"]).removeprefix("alarm.")
    state = verdict = str(alarm["verdict_state"]).replace("_", " ")
    if alarm["case_pressure_beyond"]:
        state = f"case pressure, {state}"
    mail = EmailMessage()
    # serial numbers come from files: no line break of theirs may become a header or a line of its own
    serial = " ".join(str(alarm["pump_serial"]).split())
    mail["Subject"] = f"[casedrain] pump {serial}: {state}, alarm {words}"
    mail["From"], mail["To"] = settings.mail_from, address
    mail["Date"] = formatdate(localtime=False, usegmt=True)
    mail["Message-ID"] = f"<{message_id}@casedrain>"
    lines = [
        f"Alarm {words}: pump {serial} of operator {alarm['operator']}",
        f"Verdict: {verdict} (side: {alarm['side']}), priority {alarm['priority']}",
        f"Since: {alarm['onset_at']}",
    ]
    if alarm["case_pressure_beyond"]:
        lines.append(
            "Case over reservoir pressure is at twice its own reference or beyond its limit, whatever the cause"
        )
    if alarm["candidates"]:
        lines.append("Remaining candidates: " + ", ".join(c.replace("_", " ") for c in alarm["candidates"]))
    if settings.public_url:
        lines.append(f"{settings.public_url.rstrip('/')}/")
    mail.set_content("\n".join(lines) + "\n")
    return mail
